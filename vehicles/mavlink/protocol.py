"""The one door to pymavlink: dialect `common`, protocol version 2, no types of its own.

Messages are objects of generated classes; `Message` names them in our signatures.
"""

from typing import Any, TypeAlias

from pymavlink.dialects.v20 import common  # type: ignore[import-untyped]

Message: TypeAlias = Any
"""A MAVLink message of the dialect, made by pymavlink."""

mavlink: Any = common
"""Message classes, enumerations and the codec of the dialect."""

__all__ = ["Message", "mavlink"]
