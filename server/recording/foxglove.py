"""JSON schemas of the two Foxglove messages we write, as far as we fill them.

The viewer knows a message by the name of its schema (foxglove.SceneUpdate, foxglove.Log). Fields
are those of Foxglove's published message definitions; primitives that we never draw are declared
as empty lists.
"""

from typing import Any, Final

Schema = dict[str, Any]


def _object(**fields: Schema) -> Schema:
    return {"type": "object", "properties": fields}


def _array(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_NUMBER: Final[Schema] = {"type": "number"}
_INTEGER: Final[Schema] = {"type": "integer"}
_STRING: Final[Schema] = {"type": "string"}
_BOOLEAN: Final[Schema] = {"type": "boolean"}
_TIME: Final = _object(sec=_INTEGER, nsec=_INTEGER)
_VECTOR: Final = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION: Final = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE: Final = _object(position=_VECTOR, orientation=_QUATERNION)
_COLOUR: Final = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_PAIR: Final = _object(key=_STRING, value=_STRING)
_ANYTHING: Final = _array({"type": "object"})

_SPHERE: Final = _object(pose=_POSE, size=_VECTOR, color=_COLOUR)
_CYLINDER: Final = _object(
    pose=_POSE, size=_VECTOR, bottom_scale=_NUMBER, top_scale=_NUMBER, color=_COLOUR
)
_LINE: Final = _object(
    type=_INTEGER,
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant=_BOOLEAN,
    points=_array(_VECTOR),
    color=_COLOUR,
    colors=_array(_COLOUR),
    indices=_array(_INTEGER),
)
_TEXT: Final = _object(
    pose=_POSE,
    billboard=_BOOLEAN,
    font_size=_NUMBER,
    scale_invariant=_BOOLEAN,
    color=_COLOUR,
    text=_STRING,
)
_ENTITY: Final = _object(
    timestamp=_TIME,
    frame_id=_STRING,
    id=_STRING,
    lifetime=_TIME,
    frame_locked=_BOOLEAN,
    metadata=_array(_PAIR),
    arrows=_ANYTHING,
    cubes=_ANYTHING,
    spheres=_array(_SPHERE),
    cylinders=_array(_CYLINDER),
    lines=_array(_LINE),
    triangles=_ANYTHING,
    texts=_array(_TEXT),
    models=_ANYTHING,
)

SCENE_UPDATE_SCHEMA: Final[Schema] = {
    "title": "foxglove.SceneUpdate",
    "description": "An update to the entities displayed in a 3D scene",
    **_object(
        deletions=_array(_object(timestamp=_TIME, type=_INTEGER, id=_STRING)),
        entities=_array(_ENTITY),
    ),
}

LOG_SCHEMA: Final[Schema] = {
    "title": "foxglove.Log",
    "description": "A log message",
    **_object(
        timestamp=_TIME,
        level=_INTEGER,
        message=_STRING,
        name=_STRING,
        file=_STRING,
        line=_INTEGER,
    ),
}
