"""Tags of known place that a vehicle's camera has seen, as MAVLink tells of them: LANDING_TARGET.

Whatever looks through the camera (a companion computer, a smart camera) sends one such message for
each tag, as it would for a precision landing: `target_num` is the tag's number, and the place is
given from the body (`MAV_FRAME_BODY_FRD`, `position_valid`). It says nothing of how sure it is.
"""

from math import hypot
from typing import Final, Protocol

import numpy as np

from vehicles.localization.measurements import TagSighting
from vehicles.mavlink.protocol import Message, mavlink

KIND: Final = "LANDING_TARGET"

STILL_M: Final = 0.03
PER_METRE: Final = 0.02
"""Standard deviation of a place per axis: so much, and so much for each metre of distance."""


class TagWatcher(Protocol):
    """Lays the vehicle's frame by what its camera sees."""

    @property
    def reason(self) -> str:
        """Why the frame's place is not known, empty once it is."""
        ...

    def sight(self, sighting: TagSighting, now_s: float) -> object:
        """Take the sighting of a tag, from the body."""
        ...


def sighting_of(message: Message) -> TagSighting | None:
    """Return what a LANDING_TARGET tells of a tag, None where it gives no place from the body."""
    if not message.position_valid or message.frame != mavlink.MAV_FRAME_BODY_FRD:
        return None
    # Forward, right, down on the wire; forward, left, up in the body.
    offset = np.array([message.x, -message.y, -message.z], dtype=float)
    spread_m = STILL_M + PER_METRE * hypot(message.x, message.y, message.z)
    return TagSighting(message.target_num, offset, spread_m**2 * np.eye(3))
