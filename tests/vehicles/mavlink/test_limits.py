import math
from dataclasses import replace

import pytest

from solver.setpoints import Setpoint
from vehicles.mavlink.limits import FlightLimits, Leg

LIMITS = FlightLimits(
    speed_m_s=2.0,
    leap_m=5.0,
    field_lower=(-10.0, -10.0),
    field_upper=(10.0, 10.0),
    altitude_lower_m=1.0,
    altitude_upper_m=8.0,
)
GOOD = Setpoint(7, (1.0, 0.0), (1.0, 0.0), 2.0, 0.5)
HERE = (0.0, 0.0)


def test_a_good_setpoint_passes() -> None:
    assert LIMITS.objection(GOOD, HERE) is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"velocity": (math.nan, 0.0)}, "finite"),
        ({"waypoint": (0.0, math.inf)}, "finite"),
        ({"altitude_m": math.nan}, "finite"),
        ({"ttl_s": math.inf}, "finite"),
        ({"ttl_s": 0.0}, "life time"),
        ({"ttl_s": 60.0}, "life time"),
        ({"velocity": (1.5, 1.5)}, "faster"),
        ({"waypoint": (4.0, 4.0)}, "farther"),
        ({"altitude_m": 0.5}, "altitude"),
        ({"altitude_m": 9.0}, "altitude"),
        ({"velocity": (0.0, 0.0), "waypoint": (0.0, 2.1)}, "to stand 2.1 m away"),
    ],
)
def test_objections(changes: dict[str, object], words: str) -> None:
    objection = LIMITS.objection(replace(GOOD, **changes), HERE)  # type: ignore[arg-type]
    assert objection is not None
    assert words in objection


def test_a_vehicle_may_be_told_to_stand_where_it_is_or_nearly_so() -> None:
    standing = replace(GOOD, velocity=(0.0, 0.0), waypoint=(0.0, 1.9))
    assert LIMITS.objection(standing, HERE) is None


def test_nobody_is_sent_out_of_the_field_but_anybody_may_come_back() -> None:
    outwards = replace(GOOD, waypoint=(12.0, 0.0))
    assert LIMITS.objection(outwards, (9.0, 0.0)) == "way-point outside the field"
    assert LIMITS.objection(outwards, (13.0, 0.0)) is None


@pytest.mark.parametrize(
    "changes",
    [
        {"field_lower": (10.0, -10.0)},
        {"altitude_lower_m": 9.0},
        {"altitude_lower_m": math.nan},
        {"speed_m_s": 0.0},
        {"speed_m_s": math.nan},
        {"battery_least": 1.0},
    ],
)
def test_limits_must_leave_room(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"room|above 0"):
        replace(LIMITS, **changes)  # type: ignore[arg-type]


def test_a_leg_leads_to_its_waypoint_and_stops_there() -> None:
    leg = Leg(Setpoint(7, (2.0, 0.0), (1.0, 0.0), 3.0, 0.5), HERE, 10.0)
    assert leg.until_s == 10.5
    assert leg.reference(10.0) == ((0.0, 0.0, 3.0), (2.0, 0.0, 0.0))
    assert leg.reference(10.25) == ((0.5, 0.0, 3.0), (2.0, 0.0, 0.0))
    assert leg.reference(10.75) == ((1.0, 0.0, 3.0), (0.0, 0.0, 0.0))


def test_a_leg_without_speed_is_at_its_waypoint() -> None:
    leg = Leg(Setpoint(7, (0.0, 0.0), (1.0, 0.0), 3.0, 0.5), HERE, 10.0)
    assert leg.reference(10.1) == ((1.0, 0.0, 3.0), (0.0, 0.0, 0.0))


def test_a_leg_already_there_stands() -> None:
    leg = Leg(Setpoint(7, (1.0, 0.0), HERE, 3.0, 0.5), HERE, 10.0)
    assert leg.reference(10.1) == ((0.0, 0.0, 3.0), (0.0, 0.0, 0.0))
