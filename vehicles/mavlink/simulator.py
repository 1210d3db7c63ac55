"""Runs simulated autopilots in real time over UDP."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from vehicles.alongside import alongside
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.signing import signing_key
from vehicles.mavlink.udp import Address, Endpoint, Peers, UdpSocket, open_udp, peer_of

logger = logging.getLogger(__name__)

STEP_S = 0.02
MAX_PEERS = 8


class Simulator:
    """One simulated autopilot on a socket; talks to everybody who talks to it."""

    def __init__(
        self, autopilot: SimulatedAutopilot, peers: Peers, clock: Callable[[], float]
    ) -> None:
        self.autopilot = autopilot
        self.socket: UdpSocket | None = None
        self._peers = peers
        self._clock = clock

    def receive(self, datagram: bytes, address: Address) -> None:
        """Take a datagram and answer it."""
        now_s = self._clock()
        if self._peers.admits(address, now_s):
            self._peers.hear(address, now_s)
            self._send(self.autopilot.receive(datagram, now_s))

    def step(self) -> None:
        """Let time pass and tell."""
        self._send(self.autopilot.tick(self._clock()))

    async def run(self) -> None:
        """Fly for ever."""
        while True:
            self.step()
            await asyncio.sleep(STEP_S)

    def _send(self, frames: list[bytes]) -> None:
        if self.socket is None:
            return
        for frame in frames:
            for address in self._peers.addresses():
                self.socket.send(frame, address)


@asynccontextmanager
async def flying(
    autopilot: SimulatedAutopilot,
    endpoint: Endpoint,
    clock: Callable[[], float] = time.monotonic,
) -> AsyncIterator[Simulator]:
    """Fly a simulated autopilot for the life of the context.

    Raises:
        vehicles.mavlink.udp.EndpointError: The endpoint cannot be opened.
    """
    peer = await peer_of(endpoint)
    simulator = Simulator(autopilot, Peers(peer, most=MAX_PEERS), clock)
    simulator.socket = await open_udp(endpoint, peer, simulator.receive)
    try:
        async with alongside(simulator.run()):
            yield simulator
    finally:
        await simulator.socket.close()


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
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            taken, ignored = autopilot.setpoints, autopilot.ignored_setpoints
            logger.info("%d setpoints taken, %d ignored", taken, ignored)
