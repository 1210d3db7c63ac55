"""The processes of a mission by its definition: what flies it, what simulates its world."""

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from server.api.catalogue import Definition
from server.api.models import Clock
from server.live.host import WORKER, Host, ProcessHost
from server.live.standby import Start
from server.live.world import COMMAND, WorldHost
from solver.engines import DEFAULT

if TYPE_CHECKING:
    from server.recording.playback import ReplayHost

LOCKSTEP = (sys.executable, "-m", "server.lockstep.worker")


def commands_of(definition: Definition | None) -> tuple[tuple[str, ...], ...]:
    """Return the commands of the processes that a live mission will need."""
    if definition is None or definition.clock is not Clock.REALTIME:
        return ()
    planner = _planner_command(definition)
    return (planner,) if definition.world is None else (planner, _world_command(definition.world))


def planner_host(definition: Definition, start: Start) -> Host:
    """Return what flies a mission, or shows a recorded one."""
    if definition.clock is Clock.REPLAY:
        return _replay(definition)
    if definition.clock is Clock.LOCKSTEP:
        return ProcessHost(LOCKSTEP)
    return ProcessHost(_planner_command(definition), start=start)


def world_host(definition: Definition, start: Start) -> WorldHost:
    """Return what simulates a mission's world."""
    return WorldHost(_world_command(definition.world or {}), start=start)


def _planner_command(definition: Definition) -> tuple[str, ...]:
    return _with_engine(WORKER, definition.planner["setup"]["planner"]["engine"])


def _world_command(world: Mapping[str, Any]) -> tuple[str, ...]:
    return _with_engine(COMMAND, world.get("engine"))


def _with_engine(command: tuple[str, ...], engine: str | None) -> tuple[str, ...]:
    """Return the command with the optimizer that it may load before its job comes."""
    return (*command, "--preload", engine or DEFAULT)


def _replay(definition: Definition) -> "ReplayHost":
    # Only who shows a recording pays for importing its reader.
    from server.api.archive import recording_of
    from server.recording.playback import ReplayHost

    return ReplayHost(recording_of(definition))
