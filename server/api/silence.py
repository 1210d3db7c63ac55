"""A planner that has fallen silent: it hangs, or its machine is too slow to fly.

Its vehicles hold by themselves and its end would be seen; that it merely says nothing, only
somebody who waits for it can tell.
"""

import asyncio
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from server.api.models import Clock, MissionInfo
from server.api.record import MissionRecord
from server.encoding import EventKind, MissionState, Severity
from server.live.host import Host

SILENT_S: Final = 2.0
"""A planner speaks ten times a second; one that is silent for longer hangs, or is cut off."""

TICKING: Final = frozenset({MissionState.RUNNING, MissionState.HELD})
"""States in which a mission in real time tells something at every tick."""

LOOK_S: Final = 0.5
COMPONENT: Final = "silence"


def silence_s(
    mission: MissionInfo, snapshot: Mapping[str, Any] | None, now_s: float | None = None
) -> float:
    """Return for how long a mission has been silent that makes a picture every tick.

    0 while it speaks, and for all others. Pictures carry the monotonic clock of this machine
    (seconds), which is `now_s` where nothing else is given.
    """
    made_s = None if snapshot is None else snapshot.get("stamp_s")
    if made_s is None or mission.clock is not Clock.REALTIME or mission.state not in TICKING:
        return 0.0
    age_s = (time.monotonic() if now_s is None else now_s) - float(made_s)
    return age_s if age_s > SILENT_S else 0.0


@dataclass(slots=True)
class _Heard:
    """What is known of the process that flies a mission."""

    host: Host
    since_s: float
    """When it was first seen; older pictures are another process's."""

    looks: int = 0
    """So many looks in a row found it silent."""

    told_s: float | None = None
    """For how long it had been silent at the last look, None while nothing has been told."""


class SilenceWatch:
    """Tells of the missions in real time whose planner is silent, and of its return.

    A planner is called silent by the second look that finds it so: at the first one after this
    process was stopped itself, what the planner said meanwhile has not been read yet.

    Args:
        records: Returns what is kept of every mission.
        monotonic: This machine's monotonic clock, seconds.
    """

    def __init__(
        self,
        records: Callable[[], Iterable[MissionRecord]],
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._records, self._monotonic = records, monotonic
        self._heard: dict[str, _Heard] = {}

    def look(self) -> None:
        """Look at every mission now."""
        now_s = self._monotonic()
        flown = {r.id: r for r in self._records() if r.real and r.host is not None}
        self._heard = {name: heard for name, heard in self._heard.items() if name in flown}
        for name, record in flown.items():
            assert record.host is not None
            heard = self._heard.get(name)
            if heard is None or heard.host is not record.host:
                self._heard[name] = _Heard(record.host, now_s)
            else:
                self._judge(record, heard, now_s)

    async def run(self) -> None:
        """Look for ever."""
        while True:
            self.look()
            await asyncio.sleep(LOOK_S)

    def _judge(self, record: MissionRecord, heard: _Heard, now_s: float) -> None:
        picture = record.snapshot
        spoken = picture is not None and (picture.get("stamp_s") or 0.0) >= heard.since_s
        silent_s = silence_s(record.info(), picture, now_s) if spoken else 0.0
        heard.looks = heard.looks + 1 if silent_s else 0
        if not silent_s:
            if heard.told_s is not None:
                words = f"The planner speaks again, after {heard.told_s:.0f} s."
                record.report(EventKind.ALARM, Severity.INFO, words, COMPONENT)
            heard.told_s = None
        elif heard.looks > 1:
            if heard.told_s is None:
                words = f"The planner has said nothing for {silent_s:.0f} s; its vehicles hold."
                record.report(EventKind.ALARM, Severity.ALARM, words, COMPONENT)
            heard.told_s = silent_s
