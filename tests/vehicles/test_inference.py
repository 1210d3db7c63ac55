"""What one robot infers of what cuts it off: from where it was heard, and where it is not."""

import numpy as np
import pytest

from solver.zones import Point, Zone, ZoneKind
from tests.vehicles.pilots import INFERENCE
from vehicles.inference import MOST_PLACES, OWN, JammingMap

STEP_S = 0.2


def flown(*, silent_from: int = 30, silent: int = 0, told: tuple[Zone, ...] = ()) -> JammingMap:
    """The map of a robot that flew east at 0.5 m/s, fell silent at the origin and stands there."""
    own = JammingMap(INFERENCE, (-8.0, -5.0), (8.0, 5.0))
    for step in range(silent_from + silent):
        place = (0.1 * min(0, step - silent_from), 0.0)
        own.note(STEP_S * step, place, heard=step < silent_from)
        own.zones(told)
    return own


def centre(own: JammingMap, told: tuple[Zone, ...] = ()) -> Point:
    (zone,) = own.zones(told)
    return zone.mean


def test_a_robot_that_is_heard_infers_nothing() -> None:
    assert flown().zones(()) == ()


def test_what_cut_it_off_lies_ahead_of_where_it_was_heard() -> None:
    own = flown(silent=10)
    (zone,) = own.zones(())
    assert zone.kind is ZoneKind.COMMUNICATION
    assert zone.id.startswith(OWN)
    assert (zone.risk, zone.risk_single) == (INFERENCE.risk, INFERENCE.risk_single)
    assert 0.1 < zone.mean[0] < 2.0
    assert abs(zone.mean[1]) < 0.5


def test_it_lies_where_the_robot_is_not_heard_yet() -> None:
    """It goes on to the north and is not heard there either."""
    north = flown(silent=5)
    for step in range(15):
        north.note(STEP_S * (35 + step), (0.0, 0.1 * step), heard=False)
        north.zones(())
    assert centre(north)[1] > centre(flown(silent=5))[1] + 0.2


def test_it_ends_where_the_robot_is_heard_again() -> None:
    own = flown(silent=10)
    (before,) = own.zones(())
    own.note(STEP_S * 41, (-0.4, 0.0), heard=True)
    for step in range(10):
        own.note(STEP_S * (42 + step), (-0.4, 0.0), heard=True)
        own.zones(())
    (after,) = own.zones(())
    spot = np.array([-0.4, 0.0])
    assert float(after.density(spot)) < float(before.density(spot))


def test_what_a_zone_explains_that_it_was_told_of_needs_no_other() -> None:
    known = Zone("c1", ZoneKind.COMMUNICATION, (0.5, 0.0), ((0.3, 0.0), (0.0, 0.3)), 0.0, 0.02, 0.1)
    assert flown(silent=10, told=(known,)).zones((known,)) == ()
    other_kind = Zone("s1", ZoneKind.SENSING, known.mean, known.covariance, 0.1, 0.02, 0.1)
    assert len(flown(silent=10, told=(other_kind,)).zones((other_kind,))) == 1


def test_it_remembers_where_it_was_not_heard_some_way_apart() -> None:
    own = flown()
    assert len(own.silent) == 0
    for step in range(12):
        own.note(STEP_S * (30 + step), (0.07 * step, 0.0), heard=False)
    assert np.array(own.silent)[:, 0] == pytest.approx([0.0, 0.21, 0.42, 0.63])
    own.note(STEP_S * 50, (1.0, 0.0), heard=True)
    assert len(own.silent) == 0, "it has told them when it came back"
    own.note(STEP_S * 51, (3.0, 0.0), heard=False)
    assert list(own.silent) == [(3.0, 0.0)], "the next time is another one"
    for step in range(1000):
        own.note(STEP_S * (52 + step), (3.0, 0.5 * step), heard=False)
    assert len(own.silent) == MOST_PLACES


def test_the_same_flight_gives_the_same_map() -> None:
    first, second = flown(silent=10).zones(()), flown(silent=10).zones(())
    assert first == second


@pytest.mark.parametrize("jump_s", [-5.0, 1e6])
def test_a_clock_that_jumps_leaves_a_map(jump_s: float) -> None:
    own = flown(silent=10)
    own.note(STEP_S * 40 + jump_s, (0.1, 0.0), heard=False)
    own.note(STEP_S * 41 + jump_s, (0.1, 0.0), heard=False)
    for zone in own.zones(()):
        assert np.isfinite([*zone.mean, *np.ravel(zone.covariance)]).all()
