"""The guard in the air: a real session against the simulated autopilot, in virtual time."""

import math
from collections.abc import Callable

import pytest

from solver.setpoints import Setpoint
from tests.vehicles.mavlink.air import (
    Air,
    build,
    dialect_of,
    eastward,
    flying,
    kinds_sent,
    mode,
    speed,
)
from vehicles.body import BodyEventKind as Kind
from vehicles.mavlink.dialects import ARDUPILOT, PX4, Autopilot, px4_mode
from vehicles.mavlink.flight import Start
from vehicles.mavlink.guard import Control
from vehicles.mavlink.limits import FlightLimits
from vehicles.messages import Mode, Order

BOTH = pytest.mark.parametrize("autopilot", list(Autopilot))
LOITER = {Autopilot.ARDUPILOT: 5, Autopilot.PX4: px4_mode(3)}


@BOTH
def test_setpoints_are_flown(autopilot: Autopilot) -> None:
    air = flying(autopilot)
    air.run(2.0)
    x0 = air.autopilot.flight.body.position[0]
    air.flown(2.0, eastward(air))
    assert mode(air) is Mode.FLYING
    x1 = air.autopilot.flight.body.position[0]
    air.flown(4.0, eastward(air))
    assert x1 > x0
    assert air.autopilot.flight.body.position[0] - x1 == pytest.approx(4.0, rel=0.05)
    assert air.autopilot.flight.body.position[2] == pytest.approx(2.0, abs=0.02)
    assert air.autopilot.ignored_setpoints == 0
    assert air.session.guard.refused == 0


@BOTH
def test_targets_flow_at_ten_hertz(autopilot: Autopilot) -> None:
    air = flying(autopilot)
    air.run(2.0)
    start_s = air.now_s
    air.flown(10.0, eastward(air))
    assert kinds_sent(air, start_s)["SET_POSITION_TARGET_LOCAL_NED"] == pytest.approx(100, abs=1)
    assert kinds_sent(air, start_s)["HEARTBEAT"] == pytest.approx(10, abs=1)


@BOTH
def test_it_holds_within_a_second_of_the_last_setpoint(autopilot: Autopilot) -> None:
    air = flying(autopilot)
    air.run(2.0)
    air.flown(5.0, eastward(air, 2.0))
    assert speed(air) > 1.5
    air.run(0.55)
    assert mode(air) is Mode.HOLDING
    air.run(0.45)
    assert speed(air) < 1.2
    air.run(2.0)
    assert speed(air) < 0.05


def test_no_heartbeat_without_a_living_planner() -> None:
    air = flying()
    air.run(5.0)
    assert kinds_sent(air)["HEARTBEAT"] == 0
    air.flown(3.0, eastward(air))
    assert kinds_sent(air)["HEARTBEAT"] == 3
    air.run(0.5)
    silent_s = air.now_s
    air.run(5.0)
    assert kinds_sent(air, silent_s)["HEARTBEAT"] == 0
    assert kinds_sent(air, silent_s)["SET_POSITION_TARGET_LOCAL_NED"] > 40


@BOTH
def test_a_dead_bridge_leaves_it_to_the_autopilot(autopilot: Autopilot) -> None:
    air = flying(autopilot)
    air.run(2.0)
    air.flown(4.0, eastward(air, 2.0))
    air.down = lambda frame, now_s: []
    air.run(5.0)
    assert speed(air) < 0.05
    followed = air.autopilot.flight.mode == dialect_of(autopilot).follow
    assert followed is (autopilot is Autopilot.ARDUPILOT)


@BOTH
def test_a_pilot_takes_over_and_is_not_fought(autopilot: Autopilot) -> None:
    air = flying(autopilot)
    air.run(2.0)
    air.flown(2.0, eastward(air))
    air.autopilot.flight.change_mode(LOITER[autopilot], air.now_s)
    air.flown(0.1, eastward(air))
    taken_s = air.now_s
    air.flown(20.0, eastward(air))
    sent = kinds_sent(air, taken_s)
    assert sent["SET_POSITION_TARGET_LOCAL_NED"] == 0
    assert sent["COMMAND_LONG"] == 0
    assert air.autopilot.flight.mode == LOITER[autopilot]
    assert air.session.guard.control is Control.RELEASED
    assert mode(air) is Mode.MANUAL
    assert air.count(Kind.PILOT) == 1
    assert air.count(Kind.FAILSAFE) == 0


def test_the_pilot_gives_it_back() -> None:
    air = flying()
    air.run(2.0)
    air.autopilot.flight.change_mode(5, air.now_s)
    air.flown(3.0, eastward(air))
    air.autopilot.flight.change_mode(ARDUPILOT.follow, air.now_s)
    air.flown(3.0, eastward(air))
    assert mode(air) is Mode.FLYING
    assert air.count(Kind.CONTROL) == 2


@BOTH
def test_battery_failsafe_is_told_once(autopilot: Autopilot) -> None:
    air = flying(autopilot, battery_start=0.16, battery_s=400.0)
    air.run(1.0)
    air.flown(60.0, eastward(air, 0.2))
    assert air.count(Kind.BATTERY) == 1
    assert air.count(Kind.FAILSAFE) == 1
    assert air.count(Kind.PILOT) == 0
    assert mode(air) is Mode.LANDED


@BOTH
def test_fence_failsafe_is_told_once(autopilot: Autopilot) -> None:
    air = flying(autopilot, fence_radius_m=5.0)
    air.run(1.0)
    air.flown(15.0, eastward(air))
    assert air.count(Kind.GEOFENCE) == 1
    assert air.count(Kind.FAILSAFE) == 1
    assert air.count(Kind.PILOT) == 0
    assert air.autopilot.flight.mode == dialect_of(autopilot).return_home


@BOTH
@pytest.mark.parametrize("silent_s", [5.0, 30.0])
def test_a_lost_link_comes_back_by_itself(autopilot: Autopilot, silent_s: float) -> None:
    """Without the vehicle's word nothing is sent; where it waits in our mode, we go on."""
    air = flying(autopilot, setpoint_loss_s=1e9)
    air.run(2.0)
    air.flown(2.0, eastward(air))
    air.up = lambda frame, now_s: []
    air.flown(4.0, eastward(air))
    lost_s = air.now_s
    air.flown(silent_s, eastward(air))
    assert set(kinds_sent(air, lost_s)) == {"COMMAND_LONG"}  # it knocks
    assert air.count(Kind.LINK_LOST) == 1
    air.up = lambda frame, now_s: [frame]
    air.flown(3.0, eastward(air))
    assert mode(air) is Mode.FLYING
    assert air.count(Kind.LINK_BACK) == 2
    assert air.count(Kind.PILOT) == 0


def test_a_mode_changed_in_silence_is_the_failsafes() -> None:
    air = flying(Autopilot.PX4)
    air.run(2.0)
    air.flown(2.0, eastward(air))
    air.up = air.down = lambda frame, now_s: []
    air.flown(10.0, eastward(air))
    air.up = air.down = lambda frame, now_s: [frame]
    air.flown(5.0, eastward(air))
    assert (air.count(Kind.FAILSAFE), air.count(Kind.PILOT)) == (1, 0)
    assert mode(air) is Mode.HOLDING
    air.session.order(Order.RESUME, air.now_s, "c1")
    air.flown(4.0, eastward(air))
    assert mode(air) is Mode.FLYING


@BOTH
def test_half_of_all_packets_may_be_lost(autopilot: Autopilot) -> None:
    air = flying(autopilot)
    count = 0

    def lossy(frame: bytes, now_s: float) -> list[bytes]:
        nonlocal count
        count = (count * 1103515245 + 12345) % 2**31
        return [frame] if count >> 16 & 1 else []

    air.up = air.down = lossy
    air.flown(60.0, eastward(air))
    assert mode(air) is Mode.FLYING
    assert 40.0 < air.autopilot.flight.body.position[0] < 62.0
    assert air.count(Kind.PILOT) == 0


def bad(setpoint: Setpoint) -> Callable[[float], Setpoint]:
    return lambda now_s: setpoint


def test_bad_setpoints_make_it_hold_and_are_told_once() -> None:
    air = build(start=Start.AIRBORNE, limits=FlightLimits(speed_m_s=1.0))
    air.run(1.0)
    air.flown(3.0, eastward(air))
    air.flown(3.0, bad(Setpoint(7, (math.nan, 0.0), (0.0, 0.0), 2.0, 0.5)))
    assert speed(air) < 0.1
    assert air.count(Kind.REFUSED) == 1
    assert air.session.guard.refused == pytest.approx(30, abs=1)
    air.flown(2.0, eastward(air))
    air.flown(1.0, eastward(air, 3.0))
    assert air.count(Kind.REFUSED) == 2


def test_a_lost_position_stops_the_stream() -> None:
    air = flying(Autopilot.ARDUPILOT)
    air.run(2.0)
    air.up = lambda frame, now_s: [] if frame[7] == 32 else [frame]
    air.flown(3.0, eastward(air))
    lost_s = air.now_s
    air.flown(5.0, eastward(air))
    assert air.count(Kind.POSITION_LOST) == 1
    assert kinds_sent(air, lost_s)["SET_POSITION_TARGET_LOCAL_NED"] == 0
    assert speed(air) < 0.1


def test_what_is_heard_of_another_system_changes_nothing() -> None:
    air = flying()
    other = build(Autopilot.PX4).autopilot
    air.run(2.0)
    air.up = lambda frame, now_s: [frame[:5] + b"\x08" + frame[6:]]
    before = air.session.state(air.now_s)
    air.run(1.0)
    after = air.session.state(air.now_s)
    assert before is not None
    assert after is not None
    assert before.position == after.position
    assert other.settings.system == 7


def test_the_heartbeat_of_another_kind_of_autopilot_is_not_ours() -> None:
    air = flying(Autopilot.PX4)
    air.session = build(Autopilot.ARDUPILOT).session
    air.run(3.0)
    assert air.session.counts.implausible >= 3
    assert air.count(Kind.LINK_BACK) == 0
    assert air.session.guard.control is Control.STANDBY


def test_px4_and_ardupilot_names() -> None:
    assert (ARDUPILOT.name(4), PX4.name(PX4.follow)) == ("GUIDED", "OFFBOARD")
    assert PX4.name(12345) == "mode 0x3039"


@BOTH
def test_the_reason_is_that_of_the_mode_it_is_in(autopilot: Autopilot) -> None:
    air = flying(autopilot)
    air.run(1.0)
    air.flown(2.0, eastward(air))
    assert reason(air) == "following the planner"
    air.run(1.5)
    assert (mode(air), reason(air)) == (Mode.HOLDING, "the planner's setpoints have expired")
    air.flown(1.0, eastward(air))
    assert (mode(air), reason(air)) == (Mode.FLYING, "following the planner")
    air.session.stop(air.now_s, "another robot has this id")
    air.run(0.2)
    assert (mode(air), reason(air)) == (Mode.HOLDING, "another robot has this id")
    air.flown(1.0, eastward(air))
    assert (mode(air), reason(air)) == (Mode.FLYING, "following the planner")


def reason(air: Air) -> str:
    state = air.session.state(air.now_s)
    assert state is not None
    return state.reason
