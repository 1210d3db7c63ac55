"""Throws frames with a correct checksum, and plain noise, at the bridge's receiving end.

    python -m tests.vehicles.mavlink.fuzzing --frames 1000000 --noise 1000000

Nothing may escape, nothing heard may become a setpoint of its own accord, and memory stays flat.
A finding names the seed, the number of the datagram and the datagram, so that it can be repeated.
"""

import argparse
import gc
import random
import struct
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, cast

from tests.vehicles.mavlink.air import ORIGIN
from tests.vehicles.mavlink.sent import Speaker, text
from vehicles.mavlink.alignment import DatumAlignment
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.bridge import MavlinkBody
from vehicles.mavlink.codec import Codec
from vehicles.mavlink.dialects import ARDUPILOT
from vehicles.mavlink.flight import FlightSettings, Start
from vehicles.mavlink.guard import GuardSettings
from vehicles.mavlink.limits import FlightLimits
from vehicles.mavlink.protocol import mavlink
from vehicles.mavlink.session import Session, SessionSettings
from vehicles.mavlink.udp import Address, Peers, UdpSocket
from vehicles.mavlink.validation import PLAUSIBLE

SYSTEM = 7
SENDER: Address = ("192.0.2.7", 14550)
TICK_EVERY = 20
SECONDS_EACH = 0.003

_KINDS = list(mavlink.mavlink_map.values())
_READ = [kind for kind in _KINDS if kind.msgname in PLAUSIBLE]
_NUMBERS = [
    struct.pack("<f", value)
    for value in (float("nan"), float("inf"), -float("inf"), 1e38, -1e38, 0.0, -0.0, 1e-40, 3.0)
] + [b"\xff\xff\xff\xff", b"\x00\x00\x00\x80", b"\x04\x00\x00\x00", b"\xff\xff\xff\x7f"]


class Found(Exception):
    """Raised when something has gone wrong."""


@dataclass(frozen=True, slots=True)
class Figures:
    """What a run has cost."""

    datagrams: int
    seconds: float
    growth_blocks: int
    """Blocks of memory at the end beyond those at a tenth of the run."""

    accepted: int


class Outlet:
    """A socket's sending end that keeps what is sent until it is taken."""

    def __init__(self) -> None:
        self._sent: list[bytes] = []

    def send(self, frame: bytes, address: Address) -> None:
        self._sent.append(frame)

    def take(self) -> list[bytes]:
        sent, self._sent = self._sent, []
        return sent


def session() -> Session:
    settings = SessionSettings(GuardSettings(ARDUPILOT, FlightLimits()), SYSTEM)
    return Session(settings, DatumAlignment(ORIGIN))


def frames(dice: random.Random) -> Iterator[bytes]:
    """Yield frames with a correct checksum: payloads of chance, and true ones slightly off."""
    true = true_payloads()
    while True:
        if dice.random() < 0.5:
            kind, spoken = dice.choice(true)
            payload, worst = bytearray(spoken), 2
        else:
            kind = dice.choice(_READ if dice.random() < 0.6 else _KINDS)
            payload, worst = bytearray(dice.randbytes(kind.unpacker.size)), 4
        for _ in range(dice.randrange(worst + 1)):
            at = 4 * dice.randrange(max(len(payload) // 4, 1))
            payload[at : at + 4] = dice.choice(_NUMBERS)
        if dice.random() < 0.1:
            payload = payload[: dice.randrange(len(payload) + 1)]
        elif dice.random() < 0.05:
            payload += dice.randbytes(dice.randrange(20))
        del payload[255:]
        flags = 0 if dice.random() < 0.97 else dice.randrange(256)
        frame = framed(kind, bytes(payload), flags, dice)
        yield frame + dice.randbytes(13) if flags & 1 else frame


def framed(kind: Any, payload: bytes, flags: int, dice: random.Random) -> bytes:
    """Return a frame around a payload, with the checksum it needs."""
    system = SYSTEM if dice.random() < 0.9 else dice.randrange(256)
    component = 1 if dice.random() < 0.9 else dice.randrange(256)
    head = bytes([len(payload), flags, 0, dice.randrange(256), system, component])
    body: bytes = head + kind.id.to_bytes(3, "little") + payload
    check: int = mavlink.x25crc(body + bytes([kind.crc_extra])).crc
    return b"\xfd" + body + struct.pack("<H", check)


def true_payloads() -> list[tuple[Any, bytes]]:
    """Return what a flying vehicle says: kinds and payloads."""
    settings = FlightSettings(dialect=ARDUPILOT, start=Start.AIRBORNE)
    vehicle = SimulatedAutopilot(AutopilotSettings(settings, SYSTEM, ORIGIN))
    reader = Codec(1, 1, None, None)
    spoken = [m for frame in vehicle.tick(10.0) for m in reader.decode(frame, 10.0)]
    spoken += [text("Battery Failsafe", 4), text("all is well", 0), text("Fence Breached", 2)]
    speaker = Speaker(SYSTEM)
    payloads = []
    for message in spoken:
        frame = speaker.say(message)
        kind = mavlink.mavlink_map[message.get_msgId()]
        payloads.append((kind, frame[10:-2].ljust(kind.unpacker.size, b"\0")))
    return payloads


def noise(dice: random.Random) -> Iterator[bytes]:
    """Yield strings of chance, many of which begin as frames do."""
    while True:
        string = dice.randbytes(dice.randrange(300))
        yield string if dice.random() < 0.5 else dice.choice((b"\xfd", b"\xfe")) + string


def fuzz(
    target: Session,
    source: Callable[[random.Random], Iterator[bytes]],
    count: int,
    seed: int,
) -> Figures:
    """Throw `count` datagrams at a vehicle that nobody has given a setpoint or an order.

    They go in and out where the bridge's socket does: through its body.

    Raises:
        Found: Something escaped, or a setpoint resulted.
    """
    reader = Codec(1, 1, None, None)
    datagrams = source(random.Random(seed))
    now_s, early_blocks = 10.0, 0
    out = Outlet()
    body = MavlinkBody(target, Peers(SENDER, most=1), lambda: now_s)
    body.socket = cast("UdpSocket", out)
    started_s = time.perf_counter()
    for number in range(count):
        datagram, now_s = next(datagrams), now_s + SECONDS_EACH
        try:
            body.receive(datagram, SENDER)
            if number % TICK_EVERY == 0:
                body.send_due()
            body.state(now_s)
        except Exception as error:
            where = f"seed {seed}, datagram {number}: {datagram.hex()}"
            raise Found(f"{type(error).__name__}: {error}; {where}") from error
        for frame in out.take():
            for message in reader.decode(frame, now_s):
                if message.get_type() not in ("COMMAND_LONG",):
                    raise Found(f"{message.get_type()} sent; seed {seed}, datagram {number}")
        body.take_events()
        if number == count // 10:
            early_blocks = blocks()
    growth = blocks() - early_blocks
    return Figures(count, time.perf_counter() - started_s, growth, target.counts.accepted)


def blocks() -> int:
    """Return how many blocks of memory are in use."""
    gc.collect()
    return sys.getallocatedblocks()


def main() -> int:
    """Run both kinds and print what they cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--noise", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for name, source, count in (("frames", frames, asked.frames), ("noise", noise, asked.noise)):
        figures = fuzz(session(), source, count, asked.seed)
        sys.stdout.write(f"{name}: {figures}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
