"""What a robot's set of targets promises: their predicted covariances over the next seconds.

The robot is taken to fly straight at full speed to the best of a few places (beside one of its
targets, or between them), to be kept at the rim of the zones it knows, and to measure all its
targets once per step. The price of a row is the sum over steps and targets of tr P, the same
quantity the mission accumulates.
"""

from dataclasses import dataclass

import numpy as np

from solver import matrices
from solver.arrays import BoolArray, FloatArray, IntArray
from solver.problem import SensorModel
from solver.roster import Roster
from solver.sensing import information
from solver.snapshot import Snapshot
from solver.zones import ZoneKind

_BESIDE_M = 0.35
"""Where a single measurement tells most: nearer, the sensor's floor takes over."""

_LEAST_VARIANCE = 1e-6
_GREATEST_VARIANCE = 1e4


@dataclass(frozen=True, slots=True)
class AssignmentSettings:
    """How far assignments look ahead, and when changing one is worth it."""

    speed_m_s: float = 0.5
    """How fast robots fly to their targets."""

    process_noise: float = 0.1
    """Random walk of the targets' positions, m^2/s."""

    step_s: float = 1.0
    steps: int = 8
    switching_cost: float = 0.1
    """Accumulated trace (m^2) that a new pair must save to be worth it."""

    most_columns: int = 3000
    """Up to so many columns (robot, set of targets) the choice among them is exact."""

    most_matrices: int = 5000
    """Up to so many assignments every one of them is priced."""


class Prospects:
    """Prices of rows at one snapshot."""

    def __init__(
        self,
        snapshot: Snapshot,
        roster: Roster,
        sensor: SensorModel,
        settings: AssignmentSettings,
    ) -> None:
        rows, tracks = roster.target_rows, snapshot.tracks
        self._roster, self._sensor, self._settings = roster, sensor, settings
        self.robots = snapshot.robots.positions
        """(M, 2)."""
        self.targets = tracks.positions[rows]
        """(N, 2) now."""
        self.steps = settings.steps
        times = settings.step_s * np.arange(1, settings.steps + 1)
        self._times = times
        self._targets = tracks.positions[rows] + times[:, None, None] * tracks.velocities[rows]
        self._noise = settings.process_noise * settings.step_s * np.eye(2)
        P = matrices.clamped(tracks.covariances[rows], _LEAST_VARIANCE, _GREATEST_VARIANCE)
        self._start = P
        self._zones = _KeepOut(snapshot)
        self.unseen = self.traces(np.zeros((settings.steps, len(rows), 2, 2)))
        """(N,) accumulated trace of each target that nobody sees."""

    def traces(self, summed: FloatArray) -> FloatArray:
        """Return accumulated traces (N,) for information (K, N, 2, 2) summed over robots."""
        return self._accumulated(self._start, summed)

    def traces_of(self, targets: IntArray, summed: FloatArray) -> FloatArray:
        """Return accumulated traces (B, C) of targets (B, C) for information (K, B, C, 2, 2)."""
        return self._accumulated(self._start[targets], summed)

    def row(self, robots: IntArray, members: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return what rows promise on their own.

        Args:
            robots: (B,) robot of each row.
            members: (B, C) its targets, filled up with -1.

        Returns:
            Accumulated traces (B, C), 0 where filled up; information (B, C, K, 2, 2) at the
            best place, 0 where filled up, where the robot does not see, and where nobody
            knows the target's place.
        """
        real = members >= 0
        targets = np.where(real, members, 0)
        told = real & self._roster.placed[targets] & self._roster.seeing[robots][:, None]
        paths = self._paths(robots, targets, told)
        # (B, G, K, 2) against (B, C, K, 2): information (B, G, C, K, 2, 2).
        y = np.moveaxis(self._targets[:, targets], 0, 2)
        gained = information(self._sensor, paths[:, :, None] - y[:, None])
        gained *= told[:, None, :, None, None, None]
        spread = np.moveaxis(gained, 3, 0)
        traces = self._accumulated(self._start[targets][:, None], spread) * real[:, None]
        best = np.argmin(traces.sum(axis=2), axis=1)
        each = np.arange(len(robots))
        return traces[each, best], gained[each, best]

    def _accumulated(self, P: FloatArray, summed: FloatArray) -> FloatArray:
        total: FloatArray = np.zeros(np.broadcast_shapes(P.shape, summed.shape[1:])[:-2])
        for gained in summed:
            P = matrices.inverse(matrices.inverse(P + self._noise) + gained)
            total = total + P[..., 0, 0] + P[..., 1, 1]
        return total

    def _paths(self, robots: IntArray, targets: IntArray, told: BoolArray) -> FloatArray:
        """Return positions (B, G, K, 2) on the way to each of G places worth going to."""
        start = self.robots[robots]
        y = np.moveaxis(self._targets[:, targets], 0, 2)
        counted = told[:, :, None, None]
        middle = (y * counted).sum(axis=1) / np.maximum(counted.sum(axis=1), 1)
        places = np.concatenate((y, middle[:, None]), axis=1)
        offset = places - start[:, None, None]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        way = np.maximum(distance - _BESIDE_M, 0.0)
        gone = np.minimum(way, self._settings.speed_m_s * self._times)
        paths = start[:, None, None] + (gone / np.maximum(distance, 1e-9))[..., None] * offset
        goes = np.concatenate((told, told.any(axis=1, keepdims=True)), axis=1)
        paths = np.where(goes[:, :, None, None], paths, start[:, None, None])
        return self._zones.kept_out(robots, paths)


class _KeepOut:
    """Pushes predicted positions to the rim of the zones their robots know."""

    def __init__(self, snapshot: Snapshot) -> None:
        zones, severity = snapshot.zones, snapshot.directives.severity_of
        self._known = snapshot.known
        self._centres = np.array([zone.mean for zone in zones]).reshape(-1, 2)
        self._covariances = np.array([zone.covariance for zone in zones]).reshape(-1, 2, 2)
        self._quantiles = np.array([zone.quantile(severity(zone.id)) for zone in zones])
        # A communication zone's margin grows with the team's spread: its core counts here.
        sensing = [zone.margin if zone.kind is ZoneKind.SENSING else 0.0 for zone in zones]
        self._margins = np.array(sensing)

    def kept_out(self, robots: IntArray, paths: FloatArray) -> FloatArray:
        for z, centre in enumerate(self._centres):
            offset = paths - centre
            distance = np.hypot(offset[..., 0], offset[..., 1])
            # On the centre there is no way out to be preferred: east.
            lost = distance < 1e-9
            normal = offset / np.where(lost, 1.0, distance)[..., None]
            normal[lost] = (1.0, 0.0)
            spread = np.einsum("...i,ij,...j->...", normal, self._covariances[z], normal)
            radius = self._quantiles[z] * np.sqrt(spread) + self._margins[z]
            inside = (distance < radius) & self._known[robots, z][:, None, None]
            rim = centre + radius[..., None] * normal
            paths = np.where(inside[..., None], rim, paths)
        return paths
