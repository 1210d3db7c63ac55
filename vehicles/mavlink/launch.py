"""Puts a MAVLink vehicle into a team."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from vehicles.launch import Place, pilot_for, serve
from vehicles.localization.aligner import TagAligner, TagAlignerSettings
from vehicles.localization.measurements import TagSighting
from vehicles.localization.seeking import Sighted
from vehicles.localization.senses import TagSenses
from vehicles.mavlink.alignment import Aligner, DatumAlignment, GivenAlignment, Heights
from vehicles.mavlink.bridge import connected
from vehicles.mavlink.dialects import DIALECTS, Autopilot
from vehicles.mavlink.frames import Alignment, Datum, Vector
from vehicles.mavlink.guard import GuardSettings, TakeOffRule
from vehicles.mavlink.limits import FlightLimits
from vehicles.mavlink.session import Session, SessionSettings
from vehicles.mavlink.signing import signing_key
from vehicles.mavlink.udp import Endpoint


@dataclass(frozen=True, slots=True)
class VehicleOptions:
    """One vehicle and how it is flown."""

    robot_id: int
    endpoint: Endpoint
    autopilot: Autopilot = Autopilot.ARDUPILOT
    system: int = 1
    """Its MAVLink system id."""

    take_off: TakeOffRule = TakeOffRule.FORBIDDEN
    take_off_altitude_m: float = 2.0
    """In the common frame."""

    limits: FlightLimits = field(default_factory=FlightLimits)
    datum: Datum | None = None
    """Origin of the team's common frame; None where it is the vehicle's own local frame."""

    heights: Heights = Heights.OWN_ORIGIN
    alignment: Alignment = field(default_factory=Alignment)
    """Of the local frame, where there is no datum: from a registration of tags."""

    tags: Mapping[int, Vector] | None = None
    """Places of tags in the common frame by number: they lay the local frame, instead of a datum,
    as the vehicle's camera sees them (`vehicles.mavlink.tags`)."""

    targets: Mapping[int, int] = field(default_factory=dict)
    """Targets by the numbers of their tags: the same camera sees them for the team."""

    key_file: Path | None = None
    """For MAVLink 2 signing."""

    def session(self) -> Session:
        """Return the vehicle without I/O. Raises as `fitting`."""
        return self.fitting().session

    def fitting(self) -> "Fitting":
        """Return the vehicle without I/O, and what it sees targets with.

        Raises:
            vehicles.mavlink.signing.SigningError: The key file does not serve.
            ValueError: The MAVLink ids do not do, nothing says where targets are seen from, or a
                take-off would lead to where no setpoint may send it.
        """
        low, high = self.limits.altitude_lower_m, self.limits.altitude_upper_m
        inside = low <= self.take_off_altitude_m <= high
        if self.take_off is TakeOffRule.ALLOWED and not inside:
            raise ValueError(
                f"take-off altitude {self.take_off_altitude_m:g} m: "
                f"it must lie within {low:g} and {high:g} m"
            )
        if self.targets and self.tags is None:
            raise ValueError("targets are seen by their tags where tags say where the vehicle is")
        guard = GuardSettings(
            DIALECTS[self.autopilot], self.limits, self.take_off, self.take_off_altitude_m
        )
        settings, key = SessionSettings(guard, self.system), signing_key(self.key_file)
        if self.tags is not None:
            by_tags = TagAligner(self.tags, TagAlignerSettings())
            if not self.targets:
                return Fitting(Session(settings, by_tags, key, by_tags))
            senses = TagSenses(self.robot_id, self.targets, by_tags)
            return Fitting(Session(settings, by_tags, key, _Camera(by_tags, senses)), senses)
        aligner: Aligner = GivenAlignment(self.alignment)
        if self.datum is not None:
            aligner = DatumAlignment(self.datum, self.heights)
        return Fitting(Session(settings, aligner, key))


@dataclass(frozen=True, slots=True)
class Fitting:
    """A vehicle without I/O, with its own senses where it has some."""

    session: Session
    senses: TagSenses | None = None


@dataclass(frozen=True, slots=True)
class _Camera:
    """One camera whose tags lay the frame and show targets: `vehicles.mavlink.tags.TagWatcher`."""

    aligner: TagAligner
    senses: TagSenses

    @property
    def reason(self) -> str:
        """Why the frame's place is not known, empty once it is."""
        return self.aligner.reason

    def sight(self, sighting: TagSighting, now_s: float) -> Sighted:
        """Take the sighting of a tag, from the body."""
        found = self.aligner.sight(sighting, now_s)
        self.senses.see(sighting, now_s)
        return found


async def run_vehicle(
    options: VehicleOptions, place: Place, ready: Callable[[], None] = lambda: None
) -> None:
    """Fly one vehicle over Zenoh until cancelled.

    Raises:
        vehicles.agent.DuplicateRobotError: Somebody else flies this robot.
        vehicles.bus.BusError: Nobody answers where the settings say.
        vehicles.mavlink.udp.EndpointError: The link cannot be opened.
        ValueError: Engine, key file or ids do not do.
    """
    fitting = options.fitting()
    pilot = await pilot_for(options.robot_id, place.engine)
    clock = asyncio.get_running_loop().time
    async with connected(fitting.session, options.endpoint, clock) as body:
        await serve(body, pilot, place, ready, fitting.senses)
