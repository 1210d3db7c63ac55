"""A recording shown as a mission: it speaks as a mission's process does, at its own pace.

The web side, the stream and the console need not know that nothing flies. Pausing is holding
still the picture; a replay can be wound to any instant and at other speeds.
"""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Final

from server.encoding import MissionState, number
from server.live.channel import Json, RequestRefused, frame
from server.live.outbox import Frame
from server.recording.errors import RecordingError
from server.recording.reader import Recording

PICTURE_S: Final = 0.1
"""Wall-clock seconds between two pictures."""

SLOWEST, FASTEST = 0.1, 50.0
"""Bounds of the speed."""


class ReplayHost:
    """Plays one recording. Implements `server.live.host.Host`."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._at_s = 0.0
        self._speed = 1.0
        self._playing = False
        self._mission = recording.header.mission
        self._wake = asyncio.Event()
        self._shown: tuple[int, bool, float] | None = None

    async def run(self, receive: Callable[[Frame], None]) -> int:
        """Play until cancelled."""
        events = await asyncio.to_thread(lambda: list(self._recording.events()))
        told = 0
        loop = asyncio.get_running_loop()
        while True:
            began_s = loop.time()
            self._wake.clear()
            snapshot = await asyncio.to_thread(self._recording.snapshot_at, self._at_s)
            if snapshot is not None and self._is_new(snapshot):
                receive(frame(self._dressed(snapshot)))
            while told < len(events) and events[told]["time_s"] <= self._at_s + 1e-9:
                if events[told]["kind"] != "ended":
                    receive(frame(events[told] | {"mission": self._mission}))
                told += 1
            playing = self._playing
            await self._rest()
            if playing and self._playing:
                self._advance(loop.time() - began_s)

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> Json:
        """Answer as a mission's process does. Raises RequestRefused."""
        given = dict(params or {})
        match op:
            case "prepare":
                self._mission = str(given["mission"])
                return {"endpoint": None, "recording": str(self._recording.path)}
            case "start" | "resume":
                if self._at_s >= self._recording.duration_s:
                    self._at_s = 0.0
                return self._play(playing=True)
            case "pause" | "hold":
                return self._play(playing=False)
            case "seek":
                return self._seek(float(given["time_s"]), float(given.get("speed", self._speed)))
            case "result" | "stop":
                return await self._result(op)
            case _:
                raise RequestRefused("replay", "This is a replay: nothing flies. Fork it instead.")

    def _play(self, *, playing: bool) -> Json:
        self._playing = playing
        self._wake.set()
        state = MissionState.RUNNING if playing else MissionState.PAUSED
        return {"state": state.value}

    def _seek(self, time_s: float, speed: float) -> Json:
        duration_s = self._recording.duration_s
        if not 0.0 <= time_s <= duration_s:
            raise RequestRefused(
                "out_of_range", f"time_s must lie between 0 and {duration_s:g}, not at {time_s:g}"
            )
        if not SLOWEST <= speed <= FASTEST:
            raise RequestRefused(
                "out_of_range", f"speed must lie between {SLOWEST:g} and {FASTEST:g}"
            )
        self._at_s, self._speed = time_s, speed
        return self._play(playing=self._playing)

    async def _result(self, op: str) -> Json:
        """Return the recorded mission's figures."""
        try:
            events = await asyncio.to_thread(lambda: list(self._recording.events()))
        except RecordingError as error:
            raise RequestRefused("no_result", f"{error}.") from error
        ended = [event["data"].get("result") for event in events if event["kind"] == "ended"]
        if op == "stop":
            return {"result": ended[-1] if ended else None}
        if not ended or ended[-1] is None:
            raise RequestRefused("no_result", "The recording was cut off before its figures.")
        return dict(ended[-1])

    async def _rest(self) -> None:
        """Wait for the next picture; while nothing plays, for somebody who asks for one."""
        try:
            async with asyncio.timeout(PICTURE_S if self._playing else None):
                await self._wake.wait()
        except TimeoutError:
            return

    def _advance(self, elapsed_s: float) -> None:
        self._at_s = min(self._recording.duration_s, self._at_s + self._speed * elapsed_s)
        if self._at_s >= self._recording.duration_s:
            self._playing = False

    def _is_new(self, snapshot: Json) -> bool:
        look = (snapshot["tick"], self._playing, self._speed)
        new, self._shown = look != self._shown, look
        return new

    def _dressed(self, snapshot: Json) -> Json:
        """Return a recorded snapshot as this mission's own, with where it stands in the file."""
        state = MissionState.RUNNING if self._playing else MissionState.PAUSED
        return snapshot | {
            "mission": self._mission,
            "state": state.value,
            "replay": replay_object(self._recording.duration_s, self._speed, snapshot["state"]),
        }


def replay_object(duration_s: float, speed: float, recorded_state: str) -> Json:
    """Return what a replay adds to a recorded snapshot."""
    return {
        "duration_s": number(duration_s, 3),
        "speed": speed,
        "recorded_state": recorded_state,
    }
