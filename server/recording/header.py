"""What a recording says of itself before its first tick: enough to fly the mission again."""

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from server.mission.setup import MissionSetup
from server.recording.errors import RecordingError
from solver import engines
from vehicles.world.setup import WorldSetup

METADATA_NAME: Final = "falconer"
"""Name of the MCAP metadata record."""

FORMAT_VERSION: Final = 1
"""Counted up when old readers would misread the file."""

_SETUP: Final = TypeAdapter(MissionSetup)
_WORLD: Final = TypeAdapter(WorldSetup)


@dataclass(frozen=True, slots=True)
class Header:
    """The mission of a recording."""

    mission: str
    """Id of the mission at its server, or the scenario's name in lockstep."""

    setup: MissionSetup
    world: WorldSetup | None
    """The simulated world at time 0, None where the vehicles were elsewhere."""

    tick_s: float
    """Seconds between two ticks of this flight."""

    clock: str
    """realtime or lockstep."""

    llm: str
    engine: str
    started_at: str
    """Wall clock, ISO 8601. Tells people when it was; nothing is computed from it."""

    falconer: str = ""
    """Version of the program that wrote it."""


def flight_header(
    mission: str, setup: MissionSetup, world: WorldSetup | None, llm: str, clock: str
) -> Header:
    """Return the header of a flight that begins now; `clock` is realtime or lockstep."""
    return Header(
        mission=mission,
        setup=setup,
        world=world,
        tick_s=setup.tick_s if clock == "lockstep" else setup.live_tick_s,
        clock=clock,
        llm=llm,
        engine=setup.planner.engine or engines.default_engine(),
        started_at=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def header_metadata(header: Header) -> dict[str, str]:
    """Return a header as MCAP metadata: flat strings, the setups as JSON."""
    return {
        "format": str(FORMAT_VERSION),
        "falconer": header.falconer or version("falconer"),
        "mission": header.mission,
        "clock": header.clock,
        "llm": header.llm,
        "engine": header.engine,
        "tick_s": repr(header.tick_s),
        "started_at": header.started_at,
        "setup": _SETUP.dump_json(header.setup).decode(),
        "world": "" if header.world is None else _WORLD.dump_json(header.world).decode(),
    }


def parse_header(metadata: dict[str, str]) -> Header:
    """Return the header in MCAP metadata. Raises RecordingError."""
    found = metadata.get("format", "none")
    if found != str(FORMAT_VERSION):
        raise RecordingError(
            f"it is written in format {found[:20]}, this version reads {FORMAT_VERSION}"
        )
    try:
        return Header(
            mission=metadata["mission"],
            setup=_SETUP.validate_json(metadata["setup"]),
            world=_WORLD.validate_json(metadata["world"]) if metadata["world"] else None,
            tick_s=float(metadata["tick_s"]),
            clock=metadata["clock"],
            llm=metadata["llm"],
            engine=metadata["engine"],
            started_at=metadata["started_at"],
            falconer=metadata["falconer"],
        )
    except (KeyError, ValueError, ValidationError) as error:
        raise RecordingError(f"its header cannot be read: {_first_line(error)}") from None


def header_summary(header: Header) -> dict[str, Any]:
    """Return what people want to know of a recording at a glance, as JSON values."""
    setup = header.setup
    return {
        "mission": header.mission,
        "scenario": setup.name,
        "clock": header.clock,
        "llm": header.llm,
        "gate": setup.gate.value,
        "seed": setup.seed,
        "engine": header.engine,
        "robots": len(setup.robots),
        "targets": len(setup.targets),
        "tick_s": header.tick_s,
        "started_at": header.started_at,
        "falconer": header.falconer,
    }


def _first_line(error: Exception) -> str:
    text = str(error) or repr(error)
    return json.dumps(text.splitlines()[0][:200])
