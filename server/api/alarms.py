"""Alarms: what went wrong with a mission, grouped by cause, and who has taken note of it.

They are made of the mission's events, which the journal keeps: after a restart the same events
make the same alarms, acknowledged as they were. One owner per mission: its record.
"""

import re
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from server.api.alarm_models import Acknowledgement, Alarm
from server.encoding import EventKind, Severity
from solver.observations import Link
from solver.snapshot import TrackStatus
from solver.zones import ZoneKind

Json = Mapping[str, Any]

QUIET_S: Final = 60.0
"""What has no end of its own is over after so much mission time without news of it."""

RATE_WINDOW_S: Final = 60.0
"""The rate counts this much mission time."""

SETTLE_S: Final = 2.0
"""For so long after an event a picture may still show the state before it."""

MAX_ALARMS: Final = 500
"""Of one mission; those that are over make room first."""

TIMES_KEPT: Final = 600
"""Of one alarm, for its rate."""

_RANK: Final = (Severity.INFO, Severity.WARNING, Severity.ALARM)
_MODELS: Final = {"task": "task model", "action": "action model"}
_COMPONENTS: Final = {
    "clock": "The clock has jumped",
    "journal": "The journal is not available",
    "recording": "The recording has stopped",
    "planner": "The planner has ended",
    "silence": "The planner is silent",
    "world": "The simulated world has ended",
}
_SUDDEN: Final = frozenset({"clock", "recording"})
"""Components whose trouble no event ends."""


@dataclass(frozen=True, slots=True)
class Cause:
    """What an event says about one alarm: it is so (again), or it is over."""

    id: str
    title: str = ""
    robot: int | None = None
    target: int | None = None
    over: bool = False
    lasting: bool = True
    """Whether another event will tell its end."""


def cause_of(event: Json) -> Cause | None:
    """Return what an event says about an alarm, None for one that is about none."""
    kind, data = event["kind"], event.get("data") or {}
    bad = event["severity"] != Severity.INFO
    robot, target = data.get("robot"), data.get("target")
    match kind:
        case EventKind.ATTACK if data.get("kind") == ZoneKind.SENSING:
            return Cause(f"sensing-{robot}", f"Robot {robot} is blinded", robot)
        case EventKind.RECOVERY:
            found = f"sensing-{robot}" if target is None else f"target-{target}"
            return Cause(found, over=True)
        case EventKind.LINK if "link" in data:
            lost = data["link"] == Link.LOST
            title = f"Robot {robot} is {'lost' if lost else 'cut off'}"
            return Cause(f"link-{robot}", title, robot, over=not bad)
        case EventKind.LINK if bad:
            return _bus(str(data.get("code", "")), robot)
        case EventKind.LOOP if "loop" in data:
            title = f"The {_MODELS.get(data['loop'], 'model')} gives no valid answer"
            return Cause(f"model-{_slug(data['loop'])}", title, over=not bad)
        case EventKind.LOOP if "guidance" in data:
            return Cause("guidance", "The models do not guide the team", over=not bad)
        case EventKind.HOLD if "component" in data:
            title = f"The {data['component']} was interrupted"
            return Cause("interruption", title, lasting=False)
        case EventKind.ALARM if "component" in data:
            name = str(data["component"])
            title = _COMPONENTS.get(name, f"Trouble with {name}")
            return Cause(_slug(name), title, over=not bad, lasting=name not in _SUDDEN)
        case EventKind.ALARM if target is not None:
            return Cause(f"target-{target}", f"Target {target} is lost", target=target)
        case EventKind.ALARM if "rung" in data:
            return Cause("optimizer", "The optimizer finds no new plan", lasting=False)
        case EventKind.ALARM | EventKind.ENDED if bad:
            return Cause("mission", "The mission is in trouble", lasting=False)
    return None


@dataclass(slots=True)
class _Entry:
    """One alarm as it stands."""

    number: int
    cause: Cause
    severity: Severity
    text: str
    since_s: float
    last_s: float
    count: int = 1
    over_s: float | None = None
    acknowledged: Acknowledgement | None = None
    times_s: deque[float] = field(default_factory=lambda: deque(maxlen=TIMES_KEPT))

    def told(self, now_s: float) -> Alarm:
        """Return it as told to clients, its rate that of the last minute."""
        cause = self.cause
        recent = sum(1 for time_s in self.times_s if time_s > now_s - RATE_WINDOW_S)
        return Alarm(
            id=cause.id,
            number=self.number,
            title=cause.title,
            severity="alarm" if self.severity is Severity.ALARM else "warning",
            robot=cause.robot,
            target=cause.target,
            text=self.text,
            count=self.count,
            rate_per_min=recent * 60.0 / RATE_WINDOW_S,
            since_s=self.since_s,
            last_s=self.last_s,
            over_s=self.over_s,
            active=self.over_s is None,
            acknowledged=self.acknowledged,
        )


class AlarmBook:
    """Owner of one mission's alarms. Fed with its events and pictures, in order."""

    def __init__(self) -> None:
        self._entries: dict[str, _Entry] = {}
        self._count = 0
        self._now_s = 0.0

    def all(self) -> list[Alarm]:
        """Return every alarm, the first raised first."""
        return [entry.told(self._now_s) for entry in self._entries.values()]

    def find(self, alarm_id: str) -> Alarm | None:
        """Return one alarm, None for an unknown id."""
        entry = self._entries.get(alarm_id)
        return None if entry is None else entry.told(self._now_s)

    def take(self, event: Json) -> None:
        """Take note of an event."""
        time_s = float(event["time_s"] or 0.0)
        self._move(time_s)
        data = event.get("data") or {}
        if "acknowledged" in data:
            entry = self._entries.get(data["acknowledged"])
            if entry is not None and entry.acknowledged is None:
                entry.acknowledged = Acknowledgement(by=str(data["by"]), time_s=time_s)
            return
        cause = cause_of(event)
        if cause is None:
            return
        if cause.over:
            self._end(cause.id, time_s)
        else:
            self._raise(cause, Severity(event["severity"]), str(event["text"]), time_s)

    def look(self, snapshot: Json) -> None:
        """Take note of a picture: it knows better what is over, and time goes on."""
        time_s = float(snapshot["time_s"] or 0.0)
        self._move(time_s)
        standing = [e for e in self._entries.values() if e.over_s is None]
        if not standing:
            return
        robots = {robot["id"]: robot for robot in snapshot["robots"]}
        targets = {target["id"]: target for target in snapshot["targets"]}
        for entry in standing:
            quiet_s = time_s - entry.last_s
            cause = entry.cause
            if not cause.lasting:
                over = quiet_s > QUIET_S
            else:
                over = quiet_s > SETTLE_S and _is_well(cause, robots, targets)
            if over:
                entry.over_s = time_s

    def close(self) -> None:
        """Take note that the mission is over, and with it whatever stood."""
        for alarm_id in self._entries:
            self._end(alarm_id, self._now_s)

    # ------------------------------------------------------------------ inside

    def _move(self, time_s: float) -> None:
        """Go on in time. Back in time is a new flight: what stood in the old one is over."""
        if time_s < self._now_s - SETTLE_S:
            for entry in self._entries.values():
                entry.over_s = entry.last_s if entry.over_s is None else entry.over_s
                entry.times_s.clear()
            self._now_s = time_s
        self._now_s = max(self._now_s, time_s)

    def _raise(self, cause: Cause, severity: Severity, text: str, time_s: float) -> None:
        entry = self._entries.get(cause.id)
        if entry is None:
            self._make_room()
            self._count += 1
            entry = _Entry(self._count, cause, severity, text, time_s, time_s)
            self._entries[cause.id] = entry
        else:
            anew = entry.over_s is not None
            worse = _RANK.index(severity) > _RANK.index(entry.severity)
            if anew:
                entry.since_s, entry.over_s = time_s, None
            if anew or worse:
                entry.acknowledged = None
            entry.severity = severity if anew or worse else entry.severity
            entry.cause, entry.text, entry.last_s = cause, text, time_s
            entry.count += 1
        entry.times_s.append(time_s)

    def _end(self, alarm_id: str, time_s: float) -> None:
        entry = self._entries.get(alarm_id)
        if entry is not None and entry.over_s is None:
            entry.over_s = time_s

    def _make_room(self) -> None:
        if len(self._entries) >= MAX_ALARMS:
            over = (name for name, entry in self._entries.items() if entry.over_s is not None)
            del self._entries[next(over, next(iter(self._entries)))]


def _is_well(cause: Cause, robots: dict[int, Json], targets: dict[int, Json]) -> bool:
    """Tell whether a picture shows a robot or a target in good order; it shows the planner so."""
    if cause.id in ("planner", "silence"):
        return True
    robot = None if cause.robot is None else robots.get(cause.robot)
    if robot is not None and cause.id.startswith("link-"):
        return bool(robot["link"] == Link.CONNECTED)
    if robot is not None and cause.id.startswith("sensing-"):
        return not robot["sensing_failed"]
    target = None if cause.target is None else targets.get(cause.target)
    return target is not None and target["status"] in (TrackStatus.TRACKED, TrackStatus.COASTING)


def _bus(code: str, robot: int | None) -> Cause:
    """Return the alarm of trouble on the bus: one per kind, and per robot where one is named."""
    who = "" if robot is None else f" of robot {robot}"
    words = {
        "duplicate": f"A second sender speaks for a robot{who}",
        "refused": f"Messages{who} are refused",
        "dropped": f"Messages{who} are dropped",
        "unknown": f"Messages{who} are not understood",
    }
    title = words.get(code, f"Trouble on the bus{who}")
    name = f"bus-{_slug(code)}" + ("" if robot is None else f"-{robot}")
    return Cause(name, title, robot, lasting=False)


def _slug(words: str) -> str:
    """Return words as a part of an id."""
    return re.sub(r"[^A-Za-z0-9_.]+", "-", str(words))[:32].strip("-") or "other"
