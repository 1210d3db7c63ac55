"""Puts a MAVLink vehicle into a team: link, body, agent and bus together, until cancelled."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from uuid import uuid4

from solver import engines
from solver.planner import Planner
from vehicles.agent import AgentSettings, VehicleAgent
from vehicles.bus import Bus
from vehicles.keys import TeamKeys
from vehicles.mavlink.alignment import Aligner, DatumAlignment, GivenAlignment, Heights
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.bridge import connected
from vehicles.mavlink.dialects import DIALECTS, Autopilot
from vehicles.mavlink.frames import Alignment, Datum
from vehicles.mavlink.guard import GuardSettings, TakeOffRule
from vehicles.mavlink.limits import FlightLimits
from vehicles.mavlink.session import Session, SessionSettings
from vehicles.mavlink.signing import SigningKey, read_key
from vehicles.mavlink.simulator import flying
from vehicles.mavlink.udp import Endpoint
from vehicles.onboard import OnboardPilot
from vehicles.senses import NoSenses, Senses
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

STEP_S = 0.1
"""Of the agent; the guard of the link ticks faster."""


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
    limits: FlightLimits = field(default_factory=FlightLimits)
    datum: Datum | None = None
    """Origin of the team's common frame; None where it is the vehicle's own local frame."""

    heights: Heights = Heights.OWN_ORIGIN
    alignment: Alignment = field(default_factory=Alignment)
    """Of the local frame, where there is no datum: from a registration of tags."""

    key_file: Path | None = None
    """For MAVLink 2 signing."""

    agent: AgentSettings = field(default_factory=AgentSettings)

    def session(self) -> Session:
        """Return the vehicle without I/O.

        Raises:
            vehicles.mavlink.signing.SigningError: The key file does not serve.
            ValueError: The MAVLink ids do not do.
        """
        guard = GuardSettings(
            DIALECTS[self.autopilot], self.limits, self.take_off, self.take_off_altitude_m
        )
        aligner: Aligner = GivenAlignment(self.alignment)
        if self.datum is not None:
            aligner = DatumAlignment(self.datum, self.heights)
        return Session(SessionSettings(guard, self.system), aligner, signing_key(self.key_file))


def signing_key(path: Path | None) -> SigningKey | None:
    """Return the key of a file as of now, None without a file.

    Raises:
        vehicles.mavlink.signing.SigningError: The file does not serve.
    """
    return None if path is None else SigningKey(read_key(path), time.time(), time.monotonic())


async def fly(
    options: VehicleOptions,
    bus: Bus,
    keys: TeamKeys,
    pilot: OnboardPilot,
    senses: Senses,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Fly one vehicle for its team until cancelled.

    Args:
        options: The vehicle.
        bus: Open.
        keys: The team's.
        pilot: Flies it when it is cut off.
        senses: What it notices of targets.
        ready: Called once it is announced.

    Raises:
        vehicles.agent.DuplicateRobotError: Somebody else flies this robot.
        vehicles.mavlink.udp.EndpointError: The link cannot be opened.
    """
    clock = asyncio.get_running_loop().time
    async with connected(options.session(), options.endpoint, clock) as body:
        agent = VehicleAgent(bus, keys, body, senses, pilot, uuid4().hex[:16], options.agent)
        await agent.start()
        try:
            ready()
            due_s = clock()
            while True:
                await agent.step(clock())
                due_s = max(due_s + STEP_S, clock())
                await asyncio.sleep(due_s - clock())
        finally:
            await agent.close()


async def run_vehicle(
    options: VehicleOptions,
    team: str,
    zenoh: ZenohSettings,
    engine: str | None = None,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Fly one vehicle over Zenoh until cancelled; it sees no targets of its own.

    Raises:
        vehicles.agent.DuplicateRobotError: Somebody else flies this robot.
        vehicles.bus.BusError: Nobody answers where the settings say.
        vehicles.mavlink.udp.EndpointError: The link cannot be opened.
        ValueError: Team, engine, key file or ids do not do.
    """
    keys = TeamKeys(team)
    made = await asyncio.to_thread(engines.create, engine or engines.default_engine())
    pilot = OnboardPilot(options.robot_id, Planner(made))
    async with ZenohBus(zenoh, keys.delivery) as bus:
        await fly(options, bus, keys, pilot, NoSenses(), ready)


async def run_autopilot(
    settings: AutopilotSettings,
    endpoint: Endpoint,
    key_file: Path | None = None,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Fly a simulated autopilot until cancelled.

    Raises:
        vehicles.mavlink.udp.EndpointError: The link cannot be opened.
        vehicles.mavlink.signing.SigningError: The key file does not serve.
    """
    autopilot = SimulatedAutopilot(settings, signing_key(key_file))
    clock = asyncio.get_running_loop().time
    async with flying(autopilot, endpoint, clock):
        ready()
        await asyncio.get_running_loop().create_future()
