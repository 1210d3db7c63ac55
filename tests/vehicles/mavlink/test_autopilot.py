"""The simulated autopilot over its wire, in virtual time."""

import math
from typing import Any

import pytest

from tests.vehicles.mavlink.sent import Speaker
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.codec import Codec
from vehicles.mavlink.dialects import ARDUPILOT, DIALECTS, PX4, Autopilot
from vehicles.mavlink.flight import FlightSettings, Start
from vehicles.mavlink.protocol import Message, mavlink

ACCEPTED, BUSY, DENIED, UNSUPPORTED = 0, 1, 2, 3
CUSTOM = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)


class Station:
    """A ground station on the other end."""

    def __init__(self, autopilot: Autopilot = Autopilot.ARDUPILOT, **flight: Any) -> None:
        settings = FlightSettings(dialect=DIALECTS[autopilot], **flight)
        self.vehicle = SimulatedAutopilot(AutopilotSettings(settings, system=1))
        self.heard: list[Message] = []
        self.now_s = 10.0
        self._speaker = Speaker(system=255, component=190)
        self._reader = Codec(255, 190, None, None)

    def say(self, message: Message) -> list[Message]:
        answers = self._read(self.vehicle.receive(self._speaker.say(message), self.now_s))
        self.heard += answers
        return answers

    def order(self, command: int, *parameters: float) -> int:
        filled = (*parameters, *(0.0,) * (7 - len(parameters)))
        answer = self.say(mavlink.MAVLink_command_long_message(1, 1, command, 0, *filled))[0]
        assert answer.get_type() == "COMMAND_ACK"
        assert answer.command == command
        assert (answer.target_system, answer.target_component) == (255, 190)
        return int(answer.result)

    def setpoint(self, place: tuple[float, float, float], mask: int = 0x0DC0) -> None:
        self.say(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, mask, *place, *(0.0,) * 8
            )
        )

    def wait(self, seconds: float) -> list[Message]:
        heard: list[Message] = []
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s += 0.02
            heard += self._read(self.vehicle.tick(self.now_s))
        self.heard += heard
        return heard

    def _read(self, frames: list[bytes]) -> list[Message]:
        return [m for frame in frames for m in self._reader.decode(frame, self.now_s)]

    def texts(self) -> list[str]:
        return [m.text for m in self.heard if m.get_type() == "STATUSTEXT"]


def count(messages: list[Message], kind: str) -> int:
    return sum(message.get_type() == kind for message in messages)


def test_it_tells_of_itself_at_its_rates() -> None:
    heard = Station().wait(20.0)
    for kind, number in (("HEARTBEAT", 20), ("LOCAL_POSITION_NED", 200), ("SYS_STATUS", 20)):
        assert count(heard, kind) == pytest.approx(number, abs=2)
    assert {m.get_srcSystem() for m in heard} == {1}
    assert count(heard, "GPS_GLOBAL_ORIGIN") == 0


def test_intervals_are_set_stopped_and_restored() -> None:
    station = Station()
    interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    assert station.order(interval, 32.0, 20_000.0) == ACCEPTED
    assert count(station.wait(2.0), "LOCAL_POSITION_NED") == pytest.approx(100, abs=2)
    assert station.order(interval, 32.0, -1.0) == ACCEPTED
    assert count(station.wait(2.0), "LOCAL_POSITION_NED") == 0
    assert station.order(interval, 32.0, 0.0) == ACCEPTED
    assert count(station.wait(2.0), "LOCAL_POSITION_NED") == pytest.approx(20, abs=2)
    assert station.order(interval, 9999.0, 1e5) == DENIED
    assert station.order(interval, math.nan, 1e5) == DENIED


def test_a_message_on_request() -> None:
    station = Station()
    assert station.order(mavlink.MAV_CMD_REQUEST_MESSAGE, 49.0) == ACCEPTED
    assert station.heard[-1].get_type() == "GPS_GLOBAL_ORIGIN"
    assert station.heard[-1].latitude == 470_000_000


def test_an_unknown_command_is_unsupported() -> None:
    assert Station().order(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0) == UNSUPPORTED


def test_a_command_for_another_vehicle_is_not_answered() -> None:
    message = mavlink.MAVLink_command_long_message(9, 1, 400, 0, 1.0, *(0.0,) * 6)
    station = Station()
    assert station.say(message) == []
    assert not station.vehicle.flight.armed


def test_ardupilot_takes_off_in_guided_only() -> None:
    station = Station()
    assert station.order(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == ACCEPTED
    climb = (*(0.0,) * 6, 4.0)
    assert station.order(mavlink.MAV_CMD_NAV_TAKEOFF, *climb) == DENIED
    assert station.order(mavlink.MAV_CMD_DO_SET_MODE, CUSTOM, 4.0) == ACCEPTED
    assert station.order(mavlink.MAV_CMD_NAV_TAKEOFF, *climb) == ACCEPTED
    heard = station.wait(8.0)
    assert station.vehicle.flight.body.position[2] == pytest.approx(4.0, abs=0.1)
    landed = [m.landed_state for m in heard if m.get_type() == "EXTENDED_SYS_STATE"]
    assert (landed[0], landed[-1]) == (1, 2)
    assert station.order(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == DENIED


def test_px4_wants_setpoints_before_offboard() -> None:
    station = Station(Autopilot.PX4, start=Start.AIRBORNE)
    station.vehicle.flight.mode = PX4.hold
    assert station.order(mavlink.MAV_CMD_DO_SET_MODE, CUSTOM, 6.0) == BUSY
    station.setpoint((0.0, 0.0, -2.0))
    assert station.order(mavlink.MAV_CMD_DO_SET_MODE, CUSTOM, 6.0) == ACCEPTED
    assert station.vehicle.flight.mode == PX4.follow


@pytest.mark.parametrize(
    ("autopilot", "lost_s", "mode"),
    [(Autopilot.ARDUPILOT, 3.0, ARDUPILOT.follow), (Autopilot.PX4, 1.0, PX4.hold)],
)
def test_without_setpoints_it_stops(autopilot: Autopilot, lost_s: float, mode: int) -> None:
    station = Station(autopilot, start=Start.AIRBORNE)
    for _ in range(20):
        station.setpoint((0.0, 300.0, -2.0))
        station.wait(0.1)
    station.wait(lost_s - 0.3)
    assert station.vehicle.flight.body.velocity[0] > 1.0
    station.wait(12.0)
    assert math.hypot(*station.vehicle.flight.body.velocity) < 0.05
    assert station.vehicle.flight.mode == mode


@pytest.mark.parametrize(
    ("mask", "place"),
    [
        (0x0FC0, (math.nan, 0.0, 0.0)),
        (0x0DC1, (1.0, 0.0, 0.0)),
        (0x0FC0, (1.0, 0.0, 0.0)),
        (0x0DFF, (1.0, 0.0, 0.0)),
    ],
)
def test_setpoints_it_cannot_fly_are_ignored(mask: int, place: tuple[float, float, float]) -> None:
    station = Station(start=Start.AIRBORNE)
    station.setpoint(place, mask)
    assert station.vehicle.ignored_setpoints == 1


def test_velocity_alone_is_flown() -> None:
    station = Station(start=Start.AIRBORNE)
    for _ in range(30):
        station.say(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0x0DC7, *(math.nan,) * 3, 2.0, 0.0, 0.0, *(0.0,) * 5
            )
        )
        station.wait(0.1)
    assert station.vehicle.flight.body.velocity == pytest.approx((0.0, 2.0, 0.0), abs=0.05)


def test_the_companions_silence_makes_it_return() -> None:
    station = Station(start=Start.AIRBORNE, beat_loss_s=5.0)
    station.wait(10.0)
    assert station.vehicle.flight.mode == ARDUPILOT.follow
    station.say(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    station.wait(4.5)
    assert station.vehicle.flight.mode == ARDUPILOT.follow
    station.wait(1.0)
    assert station.vehicle.flight.mode == ARDUPILOT.return_home
    assert "GCS Failsafe" in station.texts()


def test_parameters_are_listed_read_and_set() -> None:
    station = Station()
    listed = station.say(mavlink.MAVLink_param_request_list_message(1, 1))
    assert [m.param_index for m in listed] == list(range(listed[0].param_count))
    name = listed[0].param_id
    read = station.say(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    assert (read[0].param_id, read[0].param_value) == (name, listed[0].param_value)
    written = station.say(mavlink.MAVLink_param_set_message(1, 1, name.encode(), 7.5, 9))
    assert written[0].param_value == 7.5
    assert station.say(mavlink.MAVLink_param_request_read_message(1, 1, b"NOT_THERE", -1)) == []


def test_its_mission_is_empty() -> None:
    answer = station_answer(mavlink.MAVLink_mission_request_list_message(1, 1))
    assert (answer.get_type(), answer.count) == ("MISSION_COUNT", 0)


def station_answer(message: Message) -> Message:
    return Station().say(message)[0]
