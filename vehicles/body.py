"""What an agent flies: the seam between the agent and a vehicle, simulated or real.

Times are seconds on one monotonic clock of this process, positions metres in the common frame
(ENU), altitudes metres above its origin.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from solver.setpoints import Setpoint
from solver.zones import Point
from vehicles.messages import Mode, Order


class BodyEventKind(StrEnum):
    """What can happen to a body of itself."""

    LINK_LOST = "link_lost"
    """Nothing is heard of the vehicle any more."""

    LINK_BACK = "link_back"
    CONTROL = "control"
    """The vehicle follows us now."""

    PILOT = "pilot"
    """Somebody else has changed its mode; we let go."""

    FAILSAFE = "failsafe"
    """Its autopilot has changed its mode to save it; we let go."""

    WARNING = "warning"
    """Its autopilot speaks of a failsafe, and has not changed its mode."""

    BATTERY = "battery"
    GEOFENCE = "geofence"
    POSITION_LOST = "position_lost"
    """It does not know where it is, or not in the common frame."""

    STRANGER = "stranger"
    """Another vehicle, or one with another id than was said, speaks on its link."""

    NOISE = "noise"
    """Much that comes over its link cannot be used."""

    REFUSED = "refused"
    """An order or a setpoint was not carried out."""

    DONE = "done"
    """An order was carried out."""


@dataclass(frozen=True, slots=True)
class BodyEvent:
    """Something that happened to a body, told exactly once."""

    kind: BodyEventKind
    text: str
    at_s: float
    order_id: str | None = None
    """The order it is about, where it is about one."""


@dataclass(frozen=True, slots=True)
class BodyState:
    """A body as it was `age_s` ago."""

    position: Point
    velocity: Point
    altitude_m: float
    mode: Mode
    reason: str
    """Why it is in this mode."""

    armed: bool
    battery: float | None
    """Charge in [0, 1], None where it is not known."""

    age_s: float


class Body(Protocol):
    """A vehicle as its agent sees it. No call blocks; none raises on what a vehicle does."""

    def state(self, now_s: float) -> BodyState | None:
        """Return the newest state, None before the first is known."""
        ...

    def follow(self, setpoint: Setpoint, now_s: float) -> None:
        """Fly a setpoint until it expires, then hold; refused when it breaks a limit."""
        ...

    def hold(self, now_s: float, reason: str) -> None:
        """Hold position now, until the next setpoint; an order being carried out goes on."""
        ...

    def order(self, order: Order, now_s: float, order_id: str) -> None:
        """Carry out an operator's order; success or refusal comes as an event."""
        ...

    def take_events(self) -> tuple[BodyEvent, ...]:
        """Return what has happened since the last call, oldest first."""
        ...
