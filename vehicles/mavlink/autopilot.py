"""A simulated autopilot that speaks MAVLink: datagrams in, datagrams out, time as an argument.

It flies a multirotor with a second-order response, answers commands, parameters and mission
requests as ArduPilot Copter or PX4 would, and has failsafes of its own. It is what demos, tests
and people without hardware fly; nothing in it knows the bridge.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from vehicles.mavlink.codec import AUTOPILOT, Codec
from vehicles.mavlink.dialects import Autopilot
from vehicles.mavlink.flight import Answer, Flight, FlightSettings
from vehicles.mavlink.frames import Datum, flipped
from vehicles.mavlink.parameters import Parameters
from vehicles.mavlink.protocol import Message, mavlink
from vehicles.mavlink.reports import REPORTS, Reporter
from vehicles.mavlink.signing import SigningKey

FASTEST_HZ = 100.0

_RESULTS = {
    Answer.ACCEPTED: mavlink.MAV_RESULT_ACCEPTED,
    Answer.BUSY: mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
    Answer.DENIED: mavlink.MAV_RESULT_DENIED,
}
_POSITION = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
_VELOCITY = (
    mavlink.POSITION_TARGET_TYPEMASK_VX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VZ_IGNORE
)
_FORCE = mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET


@dataclass(frozen=True, slots=True)
class AutopilotSettings:
    """Who the simulated autopilot is, and where."""

    flight: FlightSettings = field(default_factory=FlightSettings)
    system: int = 1
    origin: Datum = field(default_factory=lambda: Datum(47.0, 8.0, 400.0))
    """Where its local frame lies on Earth."""


class SimulatedAutopilot:
    """One vehicle on the air."""

    def __init__(self, settings: AutopilotSettings, key: SigningKey | None = None) -> None:
        self.settings = settings
        self.flight = Flight(settings.flight)
        self.setpoints = 0
        """Setpoints taken since the start."""

        self.ignored_setpoints = 0
        """Setpoints that made no sense."""

        self._codec = Codec(settings.system, AUTOPILOT, None, key)
        self._reporter = Reporter(settings.origin)
        self._parameters = Parameters(settings.flight.dialect.autopilot)
        self._started_s: float | None = None
        self._periods_s = {kind: report.period_s for kind, report in REPORTS.items()}
        self._due_s = dict.fromkeys(REPORTS, -math.inf)
        self._shown: tuple[int, bool] | None = None
        self._commands: dict[int, Callable[[Message, float], Answer | None]] = {
            mavlink.MAV_CMD_DO_SET_MODE: self._command_mode,
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._command_arm,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._command_take_off,
            mavlink.MAV_CMD_NAV_LAND: self._command_land,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: self._command_return,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._command_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._command_message,
        }

    # ------------------------------------------------------------------ in

    def receive(self, datagram: bytes, now_s: float) -> list[bytes]:
        """Take a datagram; return the frames that answer it. Never raises."""
        self._start(now_s)
        answers: list[Message] = []
        for message in self._codec.decode(datagram, now_s):
            target = getattr(message, "target_system", 0)
            component = getattr(message, "target_component", 0)
            if target in (0, self.settings.system) and component in (0, AUTOPILOT):
                answers += self._take(message, now_s)
        return [self._codec.encode(answer, now_s) for answer in answers]

    def _take(self, message: Message, now_s: float) -> list[Message]:
        kind = message.get_type()
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            return self._command(message, now_s)
        if kind == "SET_POSITION_TARGET_LOCAL_NED":
            self._setpoint(message, now_s)
        elif kind == "SET_MODE":
            self.flight.change_mode(message.custom_mode, now_s)
        elif kind == "HEARTBEAT" and message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
            self.flight.take_beat(now_s)
        elif kind == "MISSION_REQUEST_LIST":
            return [
                mavlink.MAVLink_mission_count_message(
                    message.get_srcSystem(), message.get_srcComponent(), 0, message.mission_type
                )
            ]
        elif kind.startswith("PARAM_"):
            return self._parameters.answer(message)
        return []

    def _setpoint(self, message: Message, now_s: float) -> None:
        mask = message.type_mask
        place = flipped((message.x, message.y, message.z))
        velocity = flipped((message.vx, message.vy, message.vz))
        used = (*(() if mask & _POSITION else place), *(() if mask & _VELOCITY else velocity))
        partly = mask & _POSITION not in (0, _POSITION) or mask & _VELOCITY not in (0, _VELOCITY)
        sound = all(map(math.isfinite, used)) and used and not partly and not mask & _FORCE
        if message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED or not sound:
            self.ignored_setpoints += 1
            return
        self.setpoints += 1
        still = (0.0, 0.0, 0.0)
        self.flight.take_setpoint(
            None if mask & _POSITION else place, still if mask & _VELOCITY else velocity, now_s
        )

    def _command(self, message: Message, now_s: float) -> list[Message]:
        handler = self._commands.get(message.command)
        result = mavlink.MAV_RESULT_UNSUPPORTED
        extra: list[Message] = []
        if handler is not None:
            answer = handler(message, now_s)
            result = _RESULTS[Answer.DENIED if answer is None else answer]
            if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE and answer is Answer.ACCEPTED:
                wanted = int(message.param1)
                extra = [self._reporter.report(wanted, self.flight, self._boot_ms(now_s))]
        acknowledgement = mavlink.MAVLink_command_ack_message(
            message.command,
            result,
            target_system=message.get_srcSystem(),
            target_component=message.get_srcComponent(),
        )
        return [acknowledgement, *extra]

    # ------------------------------------------------------------------ commands

    def _command_mode(self, message: Message, now_s: float) -> Answer | None:
        main, sub = _whole(message.param2), _whole(message.param3)
        if main is None:
            return None
        mode = self.flight.settings.dialect.mode_of(main, sub or 0)
        return self.flight.change_mode(mode, now_s)

    def _command_arm(self, message: Message, now_s: float) -> Answer:
        return self.flight.arm() if message.param1 == 1.0 else self.flight.disarm()

    def _command_take_off(self, message: Message, now_s: float) -> Answer:
        """Take off: ArduPilot counts the altitude from home, PX4 from the sea, NaN its own."""
        altitude_m = message.param7 if message.get_type() == "COMMAND_LONG" else message.z
        if not math.isfinite(altitude_m):
            altitude_m = self._parameters.take_off_altitude_m
        elif self.flight.settings.dialect.autopilot is Autopilot.PX4:
            altitude_m -= self.settings.origin.altitude_m + self.flight.settings.home[2]
        return self.flight.take_off(altitude_m, now_s)

    def _command_land(self, message: Message, now_s: float) -> Answer:
        return self.flight.change_mode(self.flight.settings.dialect.land, now_s)

    def _command_return(self, message: Message, now_s: float) -> Answer:
        return self.flight.change_mode(self.flight.settings.dialect.return_home, now_s)

    def _command_interval(self, message: Message, now_s: float) -> Answer | None:
        kind, micros = _whole(message.param1), message.param2
        if kind not in REPORTS or not math.isfinite(micros):
            return None
        if micros < 0.0:
            self._periods_s[kind] = math.inf
        elif micros == 0.0:
            self._periods_s[kind] = REPORTS[kind].period_s
        else:
            self._periods_s[kind] = max(micros * 1e-6, 1.0 / FASTEST_HZ)
        self._due_s[kind] = now_s
        return Answer.ACCEPTED

    def _command_message(self, message: Message, now_s: float) -> Answer | None:
        return Answer.ACCEPTED if _whole(message.param1) in REPORTS else None

    # ------------------------------------------------------------------ out

    def tick(self, now_s: float) -> list[bytes]:
        """Let time pass up to `now_s` and return the frames due, one datagram each."""
        self._start(now_s)
        self.flight.step(now_s)
        shown = (self.flight.mode, self.flight.armed)
        if shown != self._shown:
            self._shown = shown
            self._due_s[mavlink.MAVLINK_MSG_ID_HEARTBEAT] = now_s
        messages = [
            mavlink.MAVLink_statustext_message(line.severity, line.text[:50].encode("ascii"))
            for line in self.flight.spoken
        ]
        self.flight.spoken.clear()
        for kind, period_s in self._periods_s.items():
            if now_s >= self._due_s[kind] and math.isfinite(period_s):
                behind = now_s - self._due_s[kind] >= period_s
                self._due_s[kind] = (now_s if behind else self._due_s[kind]) + period_s
                messages.append(self._reporter.report(kind, self.flight, self._boot_ms(now_s)))
        return [self._codec.encode(message, now_s) for message in messages]

    def _start(self, now_s: float) -> None:
        if self._started_s is None:
            self._started_s = now_s

    def _boot_ms(self, now_s: float) -> int:
        started_s = now_s if self._started_s is None else self._started_s
        return int((now_s - started_s) * 1000.0) & 0xFFFFFFFF


def _whole(number: float) -> int | None:
    """Return a whole number that stands in a float field, None if none does."""
    return int(number) if math.isfinite(number) and 0.0 <= number < 2**24 else None
