"""The bridge: a real vehicle as a body an agent can fly, over UDP on asyncio."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from solver.setpoints import Setpoint
from vehicles.alongside import alongside
from vehicles.body import BodyEvent, BodyState
from vehicles.mavlink.codec import Counts
from vehicles.mavlink.session import Session
from vehicles.mavlink.udp import Address, Endpoint, Peers, UdpSocket, open_udp, peer_of
from vehicles.messages import Order

TICK_S = 0.05
"""How often the guard looks; targets and heartbeats keep their own, slower rates."""

logger = logging.getLogger(__name__)


class MavlinkBody:
    """Flies one vehicle: `vehicles.body.Body`. Made by `connected`.

    Args:
        session: The vehicle without I/O.
        peers: Where it is reached.
        clock: Monotonic seconds; the same clock as the agent's.
    """

    def __init__(self, session: Session, peers: Peers, clock: Callable[[], float]) -> None:
        self._session = session
        self._peers = peers
        self._clock = clock
        self.socket: UdpSocket | None = None

    @property
    def counts(self) -> Counts:
        """Frames accepted and refused so far."""
        return self._session.counts

    # ------------------------------------------------------------------ the body

    def state(self, now_s: float) -> BodyState | None:
        """Return the vehicle's newest state, None before its place is known."""
        return self._session.state(now_s)

    def follow(self, setpoint: Setpoint, now_s: float) -> None:
        """Fly a setpoint until it expires."""
        self._session.follow(setpoint, now_s)

    def hold(self, now_s: float, reason: str) -> None:
        """Hold where it is, until the next setpoint."""
        self._session.stop(now_s, reason)

    def order(self, order: Order, now_s: float, order_id: str) -> None:
        """Carry out an operator's order."""
        self._session.order(order, now_s, order_id)

    def take_events(self) -> tuple[BodyEvent, ...]:
        """Return what has happened since the last call."""
        return self._session.take_events()

    # ------------------------------------------------------------------ the link

    def receive(self, datagram: bytes, address: Address) -> None:
        """Take a datagram off the socket; only the vehicle's heartbeat makes it our peer."""
        now_s = self._clock()
        if not self._peers.admits(address, now_s):
            self._session.counts.foreign += 1
        elif self._session.receive(datagram, now_s):
            self._peers.hear(address, now_s)

    def send_due(self) -> None:
        """Send what is due now."""
        frames = self._session.tick(self._clock())
        if self.socket is not None:
            for frame in frames:
                for address in self._peers.addresses():
                    self.socket.send(frame, address)

    async def run(self) -> None:
        """Tick for ever on a drift-free schedule; ticks that are late are skipped."""
        due_s = self._clock()
        while True:
            self.send_due()
            due_s += TICK_S
            if self._clock() - due_s > TICK_S:
                due_s = self._clock()
            await asyncio.sleep(max(due_s - self._clock(), 0.0))


@asynccontextmanager
async def connected(
    session: Session, endpoint: Endpoint, clock: Callable[[], float] = time.monotonic
) -> AsyncIterator[MavlinkBody]:
    """Open a vehicle's link and keep it going for the life of the context.

    On leaving nothing more is sent, so the autopilot's own failsafe takes over.

    Raises:
        vehicles.mavlink.udp.EndpointError: The link cannot be opened.
    """
    peer = await peer_of(endpoint)
    body = MavlinkBody(session, Peers(peer, most=1), clock)
    body.socket = await open_udp(endpoint, peer, body.receive)
    logger.info("listening for a vehicle at %s", endpoint)
    try:
        async with alongside(body.run()):
            yield body
    finally:
        await body.socket.close()
