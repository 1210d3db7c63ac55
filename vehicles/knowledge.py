"""What the planner tells a robot of the team, so that it can fly on without it."""

from dataclasses import dataclass, field

from solver.beliefs import FilterSettings
from solver.directives import Weights
from solver.exposure import FREE, Prices
from solver.observations import OnboardTrack
from solver.problem import Dynamics, SensorModel
from solver.zones import Point, Zone
from vehicles.inference import InferenceRules


@dataclass(frozen=True, slots=True)
class FlightRules:
    """What holds for one robot through a whole mission. Metres, seconds."""

    step_s: float
    """Planning step."""

    horizon: int
    dynamics: Dynamics
    control_lower: Point
    control_upper: Point
    """Box of u per axis: m/s (single integrator) or m/s^2 (double integrator)."""

    speed_limit_m_s: float
    """Bound on each axis of the velocity."""

    field_lower: Point
    field_upper: Point
    min_dist_m: float
    separation_weight: float
    sensor: SensorModel = field(default_factory=SensorModel)
    filter: FilterSettings = field(default_factory=FilterSettings)
    inference: InferenceRules | None = None
    """How it infers what cuts it off, None where zones reveal themselves."""


@dataclass(frozen=True, slots=True)
class Mate:
    """Where another robot of the team was last known to be."""

    robot_id: int
    position: Point


@dataclass(frozen=True, slots=True)
class Knowledge:
    """All that one robot takes along when it is cut off."""

    robot_id: int
    mission: str
    time_s: float
    """The moment the tracks are of, on the clock of whoever flies by them."""

    rules: FlightRules
    weights: Weights
    targets: tuple[int, ...]
    """Assigned to this robot."""

    tracks: tuple[OnboardTrack, ...]
    """The team's beliefs of these targets; a target left out is unknown."""

    zones: tuple[Zone, ...]
    """Those this robot knows."""

    severities: tuple[tuple[str, float], ...] = ()
    """(zone id, multiplier) for zones that differ from 1."""

    mates: tuple[Mate, ...] = ()

    prices: Prices = FREE
    """Of being exposed to zones."""
