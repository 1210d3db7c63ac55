"""Operators' orders in the air: a session against the simulated autopilot, in virtual time."""

import pytest

from tests.vehicles.mavlink.air import build, dialect_of, eastward, flying, kinds_sent, mode
from vehicles.body import BodyEventKind as Kind
from vehicles.mavlink.codec import Codec
from vehicles.mavlink.dialects import Autopilot, px4_mode
from vehicles.mavlink.guard import Control, TakeOffRule
from vehicles.messages import Mode, Order

BOTH = pytest.mark.parametrize("autopilot", list(Autopilot))
LOITER = {Autopilot.ARDUPILOT: 5, Autopilot.PX4: px4_mode(3)}


@BOTH
def test_an_operator_takes_it_back(autopilot: Autopilot) -> None:
    air = flying(autopilot)
    air.run(2.0)
    air.autopilot.flight.change_mode(LOITER[autopilot], air.now_s)
    air.flown(3.0, eastward(air))
    air.session.order(Order.RESUME, air.now_s, "c9")
    air.flown(4.0, eastward(air))
    assert mode(air) is Mode.FLYING
    assert [e.order_id for e in air.events if e.kind is Kind.DONE] == ["c9"]


def test_landing_is_refused_while_a_pilot_flies() -> None:
    air = flying()
    air.run(2.0)
    air.autopilot.flight.change_mode(5, air.now_s)
    air.run(2.0)
    air.session.order(Order.LAND, air.now_s, "c1")
    air.run(5.0)
    assert air.autopilot.flight.mode == 5
    assert air.count(Kind.REFUSED) == 1


@BOTH
def test_a_refused_mode_is_told_once(autopilot: Autopilot) -> None:
    follow = dialect_of(autopilot).follow
    air = flying(autopilot, refused_modes=frozenset({follow}))
    air.autopilot.flight.mode = LOITER[autopilot]
    air.run(2.0)
    air.session.order(Order.RESUME, air.now_s, "c1")
    air.flown(20.0, eastward(air))
    assert [e.order_id for e in air.events if e.kind is Kind.REFUSED] == ["c1"]
    assert air.session.guard.control is Control.STANDBY
    assert air.autopilot.flight.mode == LOITER[autopilot]


def test_an_answer_that_never_comes_is_given_up() -> None:
    air = flying()
    air.run(2.0)
    air.down = lambda frame, now_s: []
    air.session.order(Order.LAND, air.now_s, "c1")
    air.run(10.0)
    assert air.count(Kind.REFUSED) == 1
    assert kinds_sent(air, 102.0)["COMMAND_LONG"] == 3
    assert air.session.guard.control is Control.FOLLOWING


@BOTH
@pytest.mark.parametrize("order", [Order.LAND, Order.RETURN])
def test_land_and_return(autopilot: Autopilot, order: Order) -> None:
    air = flying(autopilot)
    air.run(1.0)
    air.flown(6.0, eastward(air))
    away_m = air.autopilot.flight.body.position[0]
    air.session.order(order, air.now_s, "c1")
    air.run(1.5)
    assert mode(air) is (Mode.LANDING if order is Order.LAND else Mode.RETURNING)
    air.flown(40.0, eastward(air))
    assert mode(air) is Mode.LANDED
    assert not air.autopilot.flight.armed
    x = air.autopilot.flight.body.position[0]
    assert x > away_m - 0.1 if order is Order.LAND else abs(x) < 0.5
    assert [e.order_id for e in air.events if e.kind is Kind.DONE] == ["c1"]
    assert air.count(Kind.PILOT) == 0


def test_hold_and_resume() -> None:
    air = flying()
    air.run(1.0)
    air.flown(3.0, eastward(air))
    air.session.order(Order.HOLD, air.now_s, "c1")
    air.flown(2.0, eastward(air))
    x = air.autopilot.flight.body.position[0]
    air.flown(3.0, eastward(air))
    assert mode(air) is Mode.HOLDING
    assert air.autopilot.flight.body.position[0] == pytest.approx(x, abs=0.1)
    air.session.order(Order.RESUME, air.now_s, "c2")
    air.flown(3.0, eastward(air))
    assert mode(air) is Mode.FLYING
    assert air.autopilot.flight.body.position[0] > x + 2.0


@BOTH
def test_take_off(autopilot: Autopilot) -> None:
    air = build(autopilot, take_off=TakeOffRule.ALLOWED)
    air.run(3.0)
    assert mode(air) is Mode.LANDED
    air.session.order(Order.TAKE_OFF, air.now_s, "c1")
    air.run(dialect_of(autopilot).stream_first_s + 0.7)
    assert mode(air) is Mode.CLIMBING
    air.run(6.0)
    assert mode(air) is Mode.HOLDING
    assert air.autopilot.flight.body.position[2] == pytest.approx(2.0, abs=0.1)
    assert [e.order_id for e in air.events if e.kind is Kind.DONE] == ["c1"]
    air.flown(3.0, eastward(air))
    assert mode(air) is Mode.FLYING


@BOTH
def test_nothing_arms_unless_it_is_allowed(autopilot: Autopilot) -> None:
    air = build(autopilot)
    air.run(3.0)
    air.session.order(Order.TAKE_OFF, air.now_s, "c1")
    air.session.order(Order.RESUME, air.now_s, "c2")
    air.flown(10.0, eastward(air))
    assert not air.autopilot.flight.armed
    assert [e.order_id for e in air.events if e.kind is Kind.REFUSED] == ["c1", "c2"]


def test_a_pilot_may_take_over_while_it_climbs() -> None:
    air = build(take_off=TakeOffRule.ALLOWED)
    air.autopilot.flight.mode = 5
    air.run(3.0)
    air.session.order(Order.TAKE_OFF, air.now_s, "c1")
    air.run(0.7)
    assert mode(air) is Mode.CLIMBING
    air.autopilot.flight.change_mode(5, air.now_s)
    air.run(1.0)
    taken_s = air.now_s
    air.run(10.0)
    assert air.count(Kind.PILOT) == 1
    assert kinds_sent(air, taken_s) == {}


def test_a_landed_vehicle_is_not_streamed_to() -> None:
    air = flying(Autopilot.PX4)
    air.run(2.0)
    air.autopilot.flight.body.rest(0.0)
    air.autopilot.flight.armed = False
    air.flown(2.0, eastward(air))
    landed_s = air.now_s
    air.flown(3.0, eastward(air))
    assert kinds_sent(air, landed_s)["SET_POSITION_TARGET_LOCAL_NED"] == 0


def test_an_order_that_another_replaces_is_answered_too() -> None:
    air = flying()
    air.run(2.0)
    air.down = lambda frame, now_s: []
    air.session.order(Order.LAND, air.now_s, "c1")
    air.run(0.5)
    air.session.order(Order.RETURN, air.now_s, "c2")
    air.run(20.0)
    assert [e.order_id for e in air.events if e.kind is Kind.REFUSED] == ["c1", "c2"]


def test_down_before_its_heartbeat_has_told_of_landing_counts_as_landed() -> None:
    air = flying(start_altitude_m=0.6)
    air.run(2.0)
    beats = Codec(1, 1, None, None)

    def without_beats(frame: bytes, now_s: float) -> list[bytes]:
        kinds = {message.get_type() for message in beats.decode(frame, now_s)}
        return [] if "HEARTBEAT" in kinds else [frame]

    air.up = without_beats
    air.session.order(Order.LAND, air.now_s, "c1")
    air.run(6.0)
    assert mode(air) is Mode.LANDED
    assert [e.order_id for e in air.events if e.kind is Kind.DONE] == ["c1"]


def test_another_system_on_the_link_is_told_once() -> None:
    air = flying()
    air.run(2.0)
    other = build(system=9)
    for _ in range(20):
        for frame in other.autopilot.tick(air.now_s):
            assert not air.session.receive(frame, air.now_s)
        air.run(0.1)
    assert [e.text for e in air.events if e.kind is Kind.STRANGER] == [
        "system 9 speaks on the link; only system 7 is listened to"
    ]
