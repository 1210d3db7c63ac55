"""The topics of a recording and their schemas.

The tape and the truth are written with every bit, for replay; snapshot and event are what the
stream told people, for looking; scene and log are the same again in the words that Foxglove and
Lichtblick understand.
"""

import json
from dataclasses import dataclass
from typing import Annotated, Any, Final

from pydantic import ConfigDict, Field, TypeAdapter

from server.mission.tape import Entry
from server.recording.foxglove import LOG_SCHEMA, SCENE_UPDATE_SCHEMA
from vehicles.messages import Truth

TAPE: Final = "/falconer/tape"
SNAPSHOT: Final = "/falconer/snapshot"
EVENT: Final = "/falconer/event"
TRUTH: Final = "/falconer/truth"
SCENE: Final = "/falconer/scene"
LOG: Final = "/falconer/log"

ENTRY: TypeAdapter[Entry] = TypeAdapter(
    Annotated[Entry, Field(discriminator="kind")], config=ConfigDict(ser_json_inf_nan="strings")
)
"""Tape entries to JSON and back, bit for bit, NaN and infinity included."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One channel of the file."""

    name: str
    schema_name: str
    schema: dict[str, Any]

    @property
    def schema_bytes(self) -> bytes:
        """The JSON schema as text."""
        return json.dumps(self.schema).encode()


def _message_schema(kind: str, text: str) -> dict[str, Any]:
    return {
        "title": kind,
        "description": text,
        "type": "object",
        "required": ["type", "v", "mission", "time_s"],
        "properties": {
            "type": {"const": kind},
            "v": {"type": "integer"},
            "mission": {"type": "string"},
            "time_s": {"type": "number"},
        },
    }


def topics() -> tuple[Topic, ...]:
    """Return every channel of a recording."""
    return (
        Topic(TAPE, "falconer.TapeEntry", {"type": "object", **ENTRY.json_schema()}),
        Topic(
            SNAPSHOT,
            "falconer.Snapshot",
            _message_schema("snapshot", "As on the stream: docs/reference/stream.md"),
        ),
        Topic(
            EVENT,
            "falconer.Event",
            _message_schema("event", "As on the stream: docs/reference/stream.md"),
        ),
        Topic(TRUTH, "falconer.Truth", Truth.model_json_schema()),
        Topic(SCENE, "foxglove.SceneUpdate", SCENE_UPDATE_SCHEMA),
        Topic(LOG, "foxglove.Log", LOG_SCHEMA),
    )
