import math

import pytest

from tests.vehicles.mavlink.sent import heartbeat, local_position, text
from vehicles.mavlink.protocol import mavlink
from vehicles.mavlink.telemetry import MAX_TEXTS, Telemetry


def test_a_heartbeat_tells_mode_and_arming() -> None:
    told = Telemetry()
    told.receive(heartbeat(mode=6, armed=True), 1.0)
    assert (told.mode, told.armed, told.critical, told.heartbeat_s) == (6, True, False, 1.0)
    told.receive(heartbeat(mode=5, armed=False, status=5), 2.0)
    assert (told.mode, told.armed, told.critical, told.heartbeat_s) == (5, False, True, 2.0)


def test_positions_come_in_enu() -> None:
    told = Telemetry()
    told.receive(local_position(1000, (10.0, 20.0, -3.0), (1.0, 2.0, -0.5)), 5.0)
    assert told.position == pytest.approx((20.0, 10.0, 3.0))
    assert told.velocity == pytest.approx((2.0, 1.0, 0.5))
    assert told.position_at(5.2) == pytest.approx((20.4, 10.2, 3.1))


def test_late_positions_are_ignored_and_reboots_are_not() -> None:
    told = Telemetry()
    told.receive(local_position(60_000, (1.0, 0.0, 0.0)), 1.0)
    told.receive(local_position(59_900, (2.0, 0.0, 0.0)), 1.1)
    assert told.position[1] == 1.0
    told.receive(local_position(500, (3.0, 0.0, 0.0)), 1.2)
    assert told.position[1] == 3.0


def test_attitude_yaw_is_enu() -> None:
    told = Telemetry()
    told.receive(mavlink.MAVLink_attitude_message(0, 0.1, 0.2, 0.0, 0, 0, 0), 1.0)
    assert (told.roll_rad, told.pitch_rad) == (0.1, 0.2)
    assert told.yaw_rad == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("state", "armed", "airborne"),
    [(1, True, False), (2, True, True), (2, False, False), (0, True, True), (3, True, True)],
)
def test_airborne(state: int, armed: bool, airborne: bool) -> None:
    told = Telemetry()
    told.receive(heartbeat(armed=armed), 1.0)
    told.receive(mavlink.MAVLink_extended_sys_state_message(0, state), 1.0)
    assert told.airborne is airborne


def test_battery_known_and_unknown() -> None:
    told = Telemetry()
    for remaining, expected in ((37, 0.37), (-1, None)):
        told.receive(mavlink.MAVLink_sys_status_message(*(0,) * 6, remaining, *(0,) * 6), 1.0)
        assert told.battery == expected


def test_texts_are_printable_and_bounded() -> None:
    told = Telemetry()
    for number in range(MAX_TEXTS + 5):
        told.receive(text(f"line {number}\x07"), 1.0)
    assert len(told.texts) == MAX_TEXTS
    assert told.texts[-1].text == f"line {MAX_TEXTS + 4}?"
