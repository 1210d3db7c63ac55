"""The smoothed motion of targets."""

from dataclasses import replace

import numpy as np
import pytest

from server.gate.drift import Drift
from server.mission.core import MissionCore
from solver.arrays import frozen
from solver.snapshot import TrackStatus
from tests.server.builders import mission_setup, straight_solution


def test_a_steady_motion_is_learnt_and_a_jump_is_not() -> None:
    core = MissionCore(mission_setup())
    core.commit(straight_solution(core.begin(0.0)))
    base, drift = core.snapshot, Drift(2)
    tracked = (TrackStatus.TRACKED, TrackStatus.TRACKED)
    for k in range(60):
        places = frozen([[0.1 * k, 0.0], [100.0 * (k == 30), 0.0]])
        tracks = replace(base.tracks, positions=places, status=tracked)
        drift.look(replace(base, time_s=0.5 * k, tracks=tracks))
    assert drift.velocities[0] == pytest.approx([0.2, 0.0], abs=1e-3)
    assert drift.velocities[1] == pytest.approx([0.0, 0.0])


def test_a_filter_that_knows_velocities_is_believed() -> None:
    core = MissionCore(mission_setup())
    core.commit(straight_solution(core.begin(0.0)))
    tracks = replace(core.snapshot.tracks, velocities=frozen([[0.3, 0.0], [0.0, -0.1]]))
    drift = Drift(2)
    drift.look(replace(core.snapshot, tracks=tracks))
    assert np.array_equal(drift.velocities, tracks.velocities)
