"""Alarms an autopilot raises in many ways and many times, told once each.

A battery alarm shows in the charge, in the charge state and in texts, a fence breach in its
status and in texts, every second or so. An alarm is raised by the first sign and falls when all
signs have been away for a while; only then can it be raised again.
"""

from enum import StrEnum

from vehicles.mavlink.telemetry import StatusText, Telemetry

QUIET_S = 30.0
"""Without a sign for so long, an alarm has passed."""

RECENT_S = 5.0
"""A change of mode within so long of a sign is the autopilot's own doing."""

WARNING = 4
"""MAV_SEVERITY_WARNING: texts of lesser weight raise nothing."""


class Alarm(StrEnum):
    """What is watched."""

    BATTERY = "battery"
    FENCE = "fence"
    FAILSAFE = "failsafe"
    """Any other failsafe the autopilot speaks of."""


class Watch:
    """Raises each alarm once per episode.

    Args:
        battery_least: Charge in [0, 1] at which we call the battery low ourselves.
    """

    def __init__(self, battery_least: float) -> None:
        self._battery_least = battery_least
        self._signs: dict[Alarm, float] = {}
        self._failsafe_s: float | None = None

    def look(self, telemetry: Telemetry, now_s: float) -> tuple[tuple[Alarm, str], ...]:
        """Return the alarms raised now with their words; takes the texts it reads."""
        for passed in [a for a, seen_s in self._signs.items() if now_s - seen_s > QUIET_S]:
            del self._signs[passed]
        raised: list[tuple[Alarm, str]] = []
        charge = telemetry.battery
        if charge is not None and charge <= self._battery_least:
            self._sign(Alarm.BATTERY, f"battery at {charge:.0%}", now_s, raised)
        if telemetry.battery_low:
            self._sign(Alarm.BATTERY, "the autopilot calls the battery low", now_s, raised)
        if telemetry.fence_breached:
            self._sign(Alarm.FENCE, "geofence breached", now_s, raised)
        while telemetry.texts:
            text = telemetry.texts.popleft()
            alarm = alarm_of(text)
            if alarm is not None:
                self._failsafe_s = now_s
                self._sign(alarm, text.text, now_s, raised)
        if telemetry.critical or telemetry.battery_low or telemetry.fence_breached:
            self._failsafe_s = now_s
        return tuple(raised)

    def acts(self, now_s: float) -> bool:
        """Tell whether the autopilot has lately shown reason to save the vehicle itself."""
        return self._failsafe_s is not None and now_s - self._failsafe_s <= RECENT_S

    def _sign(
        self, alarm: Alarm, words: str, now_s: float, raised: list[tuple[Alarm, str]]
    ) -> None:
        if alarm not in self._signs:
            raised.append((alarm, words))
        self._signs[alarm] = now_s


def alarm_of(text: StatusText) -> Alarm | None:
    """Return what a text of an autopilot warns of, None for everything else."""
    if text.severity > WARNING:
        return None
    words = text.text.lower()
    if "batt" in words:
        return Alarm.BATTERY
    if "fence" in words:
        return Alarm.FENCE
    return Alarm.FAILSAFE if "failsafe" in words else None
