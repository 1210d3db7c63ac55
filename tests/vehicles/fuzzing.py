"""Throws payloads at everything that listens on the bus: true messages slightly off, and noise.

    python -m tests.vehicles.fuzzing --payloads 100000

A planner's link, a simulated world with its agents, and a robot flown elsewhere share a local bus.
Nothing may escape from any of them; what is accepted is finite, inside its bounds and the same when
it is said again; the robots stay where finite numbers are and memory stays flat. A finding names
seed, number, key and payload, so that it can be repeated.
"""

import argparse
import asyncio
import copy
import gc
import json
import logging
import math
import random
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from solver.problem import Budget, Problem, Solution
from solver.zones import ZoneKind
from tests.vehicles.buses import KEYS
from tests.vehicles.pilots import Recorder
from tests.vehicles.rigs import TICK_S, Rig, rig
from tests.vehicles.samples import SAMPLES
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles import messages as wire
from vehicles import world_messages
from vehicles.keys import DOWNWARD, EXTERNAL, UPWARD, Topic
from vehicles.local_bus import LocalBus
from vehicles.world.setup import WorldTarget
from vehicles.world_link import WorldLink

TICK_EVERY = 20
OF_TOPIC: dict[Topic, type[wire.Message]] = {
    Topic.STATE: wire.State,
    Topic.DETECTIONS: wire.Detections,
    Topic.HEALTH: wire.Health,
    Topic.EVENTS: wire.Event,
    Topic.SETPOINT: wire.Setpoint,
    Topic.KNOWLEDGE: wire.Knowledge,
    Topic.COMMAND: wire.Command,
    Topic.POSE: world_messages.Pose,
    Topic.SENSES: world_messages.Senses,
    Topic.INCIDENTS: world_messages.Incident,
}
EVENTS: tuple[dict[str, Any], ...] = (
    {"type": "recovery", "kind": "communication"},
    {"type": "mode", "mode": "flying", "previous": "holding", "reason": "a setpoint"},
    {"type": "return", "tracks": [SAMPLES[wire.Knowledge]["tracks"][0]], "zones": []},
    {"type": "return", "tracks": [], "zones": [], "silent": [[1.0, 2.0]]},
    {"type": "notice", "code": "battery", "text": "20 % left"},
)
NASTY: tuple[Any, ...] = (
    *(math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 0, -1, 2**31, 2**53, 10**40),
    *(True, None, "", "\0", "\ud800", "x" * 20_000, "falconer", [], {}, [[]], [0.0] * 2000),
    *("nan", "1.0", {"type": "attack"}, 4.9e-3, 1e7, 1.0000001e7),
)


class Found(Exception):
    """Raised when something has gone wrong."""


@dataclass(frozen=True, slots=True)
class Figures:
    """What a run has cost."""

    payloads: int
    accepted: int
    seconds: float
    growth_blocks: int
    """Blocks of memory at the end beyond those at a tenth of the run."""


class Forgetful(Recorder):
    """A planner that keeps nothing."""

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        solution = super().solve(problem, budget)
        self.problems.clear()
        return solution


def said(dice: random.Random) -> Iterator[tuple[str, type[wire.Message], bytes]]:
    """Yield keys, the kind of message that belongs there, and payloads."""
    while True:
        key, kind = dice.choice(_places())
        if dice.random() < 0.05:
            yield key, dice.choice(list(SAMPLES)), noise(dice)
            continue
        values = copy.deepcopy(SAMPLES[kind])
        if kind is wire.Event and dice.random() < 0.6:
            values["event"] = copy.deepcopy(dice.choice(EVENTS))
        # Mostly that of who should speak, so that not all is refused for want of standing.
        values["boot"] = dice.choice(("b1", "b2")) if dice.random() < 0.02 else _boot(kind)
        values["seq"] = dice.randrange(2**20)
        for _ in range(dice.choice((0, 1, 1, 1, 2, 3))):
            values = changed(values, dice)
        yield key, kind, garbled(json.dumps(values).encode("utf-8", "replace"), dice)


def _boot(kind: type[wire.Message]) -> str:
    downward = (wire.Setpoint, wire.Knowledge, wire.Command, wire.Heartbeat)
    return "p1" if kind in downward else "s1"


def _places() -> Sequence[tuple[str, type[wire.Message]]]:
    ids = (21, 21, 21, 26, 99)
    robots = [(KEYS.robot(i, t), OF_TOPIC[t]) for i in ids for t in (*UPWARD, *DOWNWARD)]
    links = [(KEYS.external(i, t), OF_TOPIC[t]) for i in ids for t in EXTERNAL]
    others: list[tuple[str, type[wire.Message]]] = [
        (KEYS.heartbeat, wire.Heartbeat),
        (KEYS.truth, wire.Truth),
        (KEYS.control, wire.WorldControl),
    ]
    return [*robots, *links, *others]


def changed(values: Any, dice: random.Random) -> Any:
    """Return values with one of them, however deep, made nasty, left out, doubled or added."""
    if isinstance(values, dict) and values and dice.random() < 0.93:
        name = dice.choice(list(values))
        roll = dice.random()
        if roll < 0.08:
            del values[name]
        elif roll < 0.14:
            values[dice.choice(("v", "extra", "\u202e", name + "_"))] = dice.choice(NASTY)
        else:
            values[name] = changed(values[name], dice)
        return values
    if isinstance(values, list) and values and dice.random() < 0.9:
        at = dice.randrange(len(values))
        roll = dice.random()
        if roll < 0.1:
            return values * dice.choice((0, 2, 300))
        if roll < 0.2:
            return values[:at]
        values[at] = changed(values[at], dice)
        return values
    if isinstance(values, float | int) and not isinstance(values, bool) and dice.random() < 0.5:
        return values * dice.choice((-1, 2, 1e3, 1e9, 1e-9))
    return copy.deepcopy(dice.choice(NASTY))


def garbled(payload: bytes, dice: random.Random) -> bytes:
    """Return a payload, now and then cut short or with some bytes changed."""
    roll = dice.random()
    if roll < 0.04:
        return payload[: dice.randrange(len(payload) + 1)]
    if roll < 0.08:
        spoiled = bytearray(payload)
        for _ in range(dice.randrange(1, 6)):
            spoiled[dice.randrange(len(spoiled))] = dice.randrange(256)
        return bytes(spoiled)
    return payload


def noise(dice: random.Random) -> bytes:
    """Return what is no message at all."""
    return dice.choice(
        (
            dice.randbytes(dice.randrange(300)),
            b"[" * dice.randrange(100_000),
            b'{"v":' * dice.randrange(20_000),
            b"",
            b"null",
            b"1" * dice.randrange(6000),
            b"\xef\xbb\xbf{}",
            b" " * (wire.MAX_PAYLOAD + dice.randrange(3)),
        )
    )


def check(kind: type[wire.Message], payload: bytes) -> bool:
    """Decode as a receiver does; tell whether it is accepted.

    Raises:
        Found: Something is accepted that cannot be said again, or is not finite.
    """
    try:
        message = wire.decode(kind, payload)
    except wire.MessageError:
        return False
    if not all(map(math.isfinite, _numbers(message.model_dump()))):
        raise Found("a number that is not finite was accepted")
    if wire.decode(kind, wire.encode(message)) != message:
        raise Found("not the same when it is said again")
    return True


def _numbers(values: Any) -> Iterator[float]:
    if isinstance(values, dict):
        values = list(values.values())
    if isinstance(values, list | tuple):
        for value in values:
            yield from _numbers(value)
    elif isinstance(values, float):
        yield values


async def fuzz(count: int, seed: int) -> Figures:
    """Throw `count` payloads at a team.

    Raises:
        Found: Something escaped or went astray.
    """
    setup = world_setup(
        (robot(21, 0.0), robot(26, 5.0)),
        (WorldTarget(122, (3.0, 4.0)),),
        (zone("s1", ZoneKind.SENSING, (3.0, 0.0)),),
    )
    source = said(random.Random(seed))
    accepted, early_blocks, began_s = 0, 0, time.perf_counter()
    async with (
        rig(setup, planner=Forgetful(), external=(26,)) as team,
        LocalBus(team.hub) as bus,
        WorldLink(26, bus, KEYS, "w1") as elsewhere,
    ):
        for number in range(count):
            key, kind, payload = next(source)
            try:
                accepted += check(kind, payload)
                team.hub.publish(key, payload)
                if number % TICK_EVERY == 0:
                    await _live(team, elsewhere)
            except Exception as error:
                where = f"seed {seed}, payload {number} on {key}: {payload[:2000]!r}"
                raise Found(f"{type(error).__name__}: {error}; {where}") from error
            if number == count // 10:
                early_blocks = blocks()
    growth = blocks() - early_blocks
    return Figures(count, accepted, time.perf_counter() - began_s, growth)


async def _live(team: Rig, elsewhere: WorldLink) -> None:
    """Let everybody read what waits; what they know of the world stays finite."""
    await team.tick()
    elsewhere.listen(team.now_s)
    elsewhere.take_incidents()
    team.observed.clear()
    team.notices.clear()
    place = (*team.position(21), *team.velocity(21))
    if not all(math.isfinite(number) and abs(number) < 1e7 for number in place):
        raise Found(f"robot 21 is at {place} after {team.now_s - 1000.0:.1f} s")
    speed = math.hypot(*team.velocity(21))
    if speed > 2.0**0.5 + 1e-9:
        raise Found(f"robot 21 flies at {speed} m/s, {TICK_S} s after its limit of 1 per axis")


def blocks() -> int:
    """Return how many blocks of memory are in use."""
    gc.collect()
    return sys.getallocatedblocks()


def main() -> int:
    """Run and print what it cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--payloads", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    # Every refusal is logged: a hundred thousand lines that nobody reads.
    logging.disable(logging.ERROR)
    sys.stdout.write(f"{asyncio.run(fuzz(asked.payloads, asked.seed))}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
