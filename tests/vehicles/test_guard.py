"""Which setpoints are taken."""

from vehicles.guard import SetpointGuard
from vehicles.messages import Setpoint


def setpoint(
    seq: int = 0, boot: str = "p1", stamp_s: float = 100.0, ttl_s: float = 0.5, robot_id: int = 21
) -> Setpoint:
    return Setpoint(
        v=1,
        boot=boot,
        seq=seq,
        stamp_s=stamp_s,
        robot_id=robot_id,
        mission="m1",
        ttl_s=ttl_s,
        velocity=(0.1, 0.0),
        waypoint=(1.0, 0.0),
        altitude_m=1.0,
    )


def test_setpoints_are_taken_in_order_and_once() -> None:
    guard = SetpointGuard(21)
    assert guard.refusal(setpoint(seq=5), 0.0) is None
    assert guard.refusal(setpoint(seq=5), 0.0) == "older than the last one"
    assert guard.refusal(setpoint(seq=4), 0.0) == "older than the last one"
    assert guard.refusal(setpoint(seq=9), 0.0) is None


def test_anothers_setpoint_is_refused_and_changes_nothing() -> None:
    guard = SetpointGuard(21)
    assert guard.refusal(setpoint(robot_id=26), 0.0) == "meant for robot 26"
    assert guard.refusal(setpoint(boot="p2"), 0.0) is None


def test_one_planner_at_a_time_and_the_next_when_the_first_is_silent() -> None:
    guard = SetpointGuard(21)
    assert guard.refusal(setpoint(seq=7), 0.0) is None
    assert guard.refusal(setpoint(boot="p2"), 0.4) == "another planner is in charge"
    assert guard.refusal(setpoint(boot="p2"), 0.5) is None
    assert guard.refusal(setpoint(seq=8), 0.6) == "another planner is in charge"


def test_what_the_link_has_held_back_for_too_long_has_expired() -> None:
    guard = SetpointGuard(21)
    assert guard.refusal(setpoint(0, stamp_s=100.0), 50.0) is None
    assert guard.refusal(setpoint(1, stamp_s=100.1), 50.4) is None, "0.3 s late: still alive"
    assert guard.refusal(setpoint(2, stamp_s=100.2), 50.8) == "expired on its way"
    assert guard.refusal(setpoint(3, stamp_s=101.0), 51.0) is None
    assert guard.refusal(setpoint(4, stamp_s=101.1), 50.9) is None, "a quicker way than ever"
    assert guard.refusal(setpoint(5, stamp_s=101.2), 51.6) == "expired on its way"


def test_a_refused_setpoint_does_not_keep_its_planner_in_charge() -> None:
    guard = SetpointGuard(21)
    assert guard.refusal(setpoint(0), 0.0) is None
    assert guard.refusal(setpoint(0), 0.4) is not None
    assert guard.refusal(setpoint(boot="p2"), 0.6) is None
