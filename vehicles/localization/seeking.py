"""From the first sightings of known tags to a registration that is sure enough to fly by."""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum

from vehicles.localization.registration import (
    Landmark,
    Registration,
    RegistrationError,
    register,
)


class Sighted(StrEnum):
    """What became of the sighting of a tag."""

    IGNORED = "ignored"
    """No tag whose place is known, or where the vehicle is in its own frame is not."""

    KEPT = "kept"
    """For a registration that is not sure enough yet."""

    REGISTERED = "registered"
    """With it the frame's place is known."""

    TAKEN = "taken"
    OUTLIER = "outlier"
    """Too unlikely; left out."""

    LOST = "lost"
    """One outlier too many: the frame's place is not known any more, and sought anew."""


@dataclass(frozen=True, slots=True)
class SeekSettings:
    """When a registration is believed, and when it is given up.

    Raises:
        ValueError: A number makes no sense.
    """

    least: int = 10
    """Sightings before the first try."""

    most: int = 40
    """Sightings kept; the oldest go first."""

    sure_m: float = 0.1
    """Standard deviation of the vehicle's place from which a registration is believed."""

    lost_after: int = 10
    """So many outliers running, and the registration was wrong or the frame has jumped."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not 3 <= self.least <= self.most <= 200:
            raise ValueError("a registration takes 3 to 200 sightings, least not above most")
        if not self.sure_m > 0.0 or self.lost_after < 1:
            raise ValueError("sure_m must be above 0, lost_after at least 1")


class Seeker:
    """Collects landmarks until they register. A try takes about a millisecond.

    Args:
        settings: When a registration is believed.
    """

    def __init__(self, settings: SeekSettings) -> None:
        self._settings = settings
        self._kept: deque[Landmark] = deque(maxlen=settings.most)
        self.reason = "no tag of known place has been seen"
        """Why there is no registration yet, in words for people."""

    def add(self, mark: Landmark) -> Registration | None:
        """Take one landmark; return the registration once it is sure enough."""
        self._kept.append(mark)
        missing = self._settings.least - len(self._kept)
        if missing > 0:
            self.reason = f"{missing} more sightings of tags of known place are needed"
            return None
        try:
            found = register(self._kept)
        except RegistrationError as error:
            self.reason = str(error)
            return None
        spread_m = found.spread_m(mark.odometry)
        if spread_m > self._settings.sure_m:
            self.reason = f"the place is known to {spread_m:.2f} m only"
            return None
        self.reason = ""
        return found

    def start_over(self, reason: str) -> None:
        """Forget every landmark."""
        self._kept.clear()
        self.reason = reason
