"""What the web side does with recordings: list, replay, fork.

A fork is computed in a process of its own, one at a time: it plans hundreds of ticks as fast as it
can, and nothing of that may cost the page or the stream a moment.
"""

import asyncio
import contextlib
import json
import sys
from collections.abc import Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final

from server.api.catalogue import Definition
from server.api.errors import ServiceError
from server.api.models import Clock, MissionInfo
from server.api.service import MissionService
from server.live.priority import give_way
from server.mission.setup import GateMode
from server.recording.errors import RecordingError
from server.recording.reader import Recording, open_recording
from server.recording.shelf import Info, Shelf, Stamp

FORK_S: Final = 300.0
"""Longest a fork may take."""

MAX_REPLAYS: Final = 4
"""Shown at once."""

AUTHOR: Final = "replay"


class Archive:
    """Owner of the recordings' folder and of the one fork that may be under way."""

    def __init__(self, service: MissionService, folder: Path | None) -> None:
        self._service = service
        self._shelf = None if folder is None else Shelf(folder)
        self._known: dict[Stamp, Info] = {}
        """The folder as it was seen last."""

        self._showing = asyncio.Lock()
        self._forking = asyncio.Lock()

    async def recordings(self) -> list[dict[str, Any]]:
        """Return what lies in the folder, newest first; nothing where none is set."""
        if self._shelf is None:
            return []
        self._known = await asyncio.to_thread(self._shelf.recordings, self._known)
        return list(self._known.values())

    async def replay(self, name: str) -> MissionInfo:
        """Show a recording as a mission; one that is shown already is returned as it is.

        Raises ServiceError 404, 409.
        """
        if self._shelf is None:
            raise _unknown(f"There is no recording {name}: FALCONER_RECORDINGS names no folder.")
        try:
            recording = await asyncio.to_thread(self._shelf.open, name)
        except RecordingError as error:
            raise _unknown(f"Recording {name} cannot be opened: {error}.") from error
        async with self._showing:
            return self._shown(recording) or await self._show(recording)

    def _shown(self, recording: Recording) -> MissionInfo | None:
        """Return the mission that shows a recording. Raises ServiceError 409 for one too many."""
        shown = [record for record in self._service.records() if record.replays and record.live]
        for record in shown:
            if record.recording == recording.path:
                return record.info()
        if len(shown) >= MAX_REPLAYS:
            raise ServiceError(
                "too_many_replays",
                f"{MAX_REPLAYS} recordings are shown already; stop one of those missions first.",
                HTTPStatus.CONFLICT,
            )
        return None

    async def _show(self, recording: Recording) -> MissionInfo:
        mission = await self._service.add(replay_definition(recording), AUTHOR)
        return await self._service.start(mission.id, AUTHOR)

    async def fork(
        self,
        mission_id: str,
        at_s: float,
        llm: str,
        gate: GateMode | None,
        seed: int | None,
        comments: Sequence[tuple[float, str]],
    ) -> dict[str, Any]:
        """Fly a recorded mission on from an instant, otherwise; return both stories' figures.

        Raises ServiceError 404, 409 (not recorded, or the instant is not in it), 422, 429, 503.
        """
        path = self._service.recording(mission_id)
        if self._forking.locked():
            raise ServiceError(
                "busy", "A fork is being computed; try again.", HTTPStatus.TOO_MANY_REQUESTS
            )
        said = [word for time_s, text in comments for word in ("--comment", f"{time_s!r}:{text}")]
        judged = [] if gate is None else ["--gate", gate.value]
        dice = [] if seed is None else ["--seed", str(seed)]
        address = self._service.model_address(llm)
        async with self._forking:
            return await _computed(
                [str(path), "--fork-at", repr(at_s), "--llm", address, *judged, *dice, *said]
            )


def replay_definition(recording: Recording) -> Definition:
    """Return the definition of a mission that only shows a recording."""
    header = recording.header
    return Definition(
        scenario=header.setup.name,
        llm=header.llm,
        seed=header.setup.seed,
        clock=Clock.REPLAY,
        gate=header.setup.gate,
        planner={"recording": str(recording.path)},
        world=None,
    )


def recording_of(definition: Definition) -> Recording:
    """Open the recording that a replay shows. Raises RecordingError."""
    return open_recording(Path(definition.planner["recording"]))


async def _computed(arguments: list[str]) -> dict[str, Any]:
    """Run `falconer replay` on its own and return what it printed. Raises ServiceError."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "server.cli", "replay", *arguments, "--json",
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    give_way(process.pid)
    try:
        async with asyncio.timeout(FORK_S):
            output, errors = await process.communicate()
    except TimeoutError:
        raise ServiceError(
            "fork_timeout",
            f"The fork was not done after {FORK_S:g} s.",
            HTTPStatus.SERVICE_UNAVAILABLE,
        ) from None
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    if process.returncode != 0:
        lines = errors.decode(errors="replace").strip().splitlines() or ["no reason was given"]
        raise ServiceError("fork_refused", lines[-1][:500], HTTPStatus.CONFLICT)
    answer: dict[str, Any] = json.loads(output)
    return answer


def _unknown(words: str) -> ServiceError:
    return ServiceError("recording_unknown", words, HTTPStatus.NOT_FOUND)
