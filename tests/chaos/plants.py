"""A bug planted for each invariant, outside of the product: the same checks must catch it.

The product has no switch for this. What misbehaves is a stranger on the bus, a proxy that forges
what the server says, a vehicle that is set up wrongly, or somebody with the database's file.
"""

import asyncio
import math
import os
import re
import signal
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

from tests.chaos.ear import Unreported, alarmed, linked
from tests.chaos.journals import asked, doctor
from tests.chaos.processes import killed, lives, stopped
from tests.chaos.team import APART, OUTSIDE, ROBOTS, Team, team
from tests.chaos.watch import Invariant
from tests.faults.links import until
from tests.patience import HOLD_S, busy
from vehicles import messages as wire
from vehicles.keys import Topic

CATCH_S = 25.0
"""Within so long, on an idle machine, whoever watches has noticed. A vehicle's first plan of its
own loads the kernels."""

PERIOD_S = 0.1
MEETING_S = 30.0
"""Beyond the time that two robots need to meet."""

CLOSING_M_S = 0.5
"""Of each of them."""

SUPPRESSED_S = 10.0
Velocities = Mapping[int, tuple[float, float]]

WEIGHT = re.compile(rb'("weights": ?\{"tracking": ?)([0-9.]{2,})')
LOST = re.compile(rb'("link": ?)"lost"')


@dataclass(frozen=True)
class Caught:
    """What became of a planted bug."""

    invariant: Invariant
    planted: str
    text: str
    """What was found, "" when it was not."""

    @property
    def caught(self) -> bool:
        """Whether it was found."""
        return bool(self.text)

    def shown(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {**asdict(self), "caught": self.caught}


@dataclass
class Ghost:
    """Somebody who sends setpoints and heartbeats as if he were the planner."""

    made: Team
    boot: str
    sent: int = 0

    async def fly(self, velocities: Velocities) -> None:
        """Send every robot named a setpoint, and all a heartbeat, for one period."""
        made, keys = self.made, self.made.watch.keys
        self.sent += 1
        header: dict[str, Any] = {"v": 1, "boot": self.boot, "seq": self.sent}
        header["stamp_s"] = monotonic()
        beat = wire.Heartbeat(
            **header, mission="m1", tick=self.sent, time_s=0.0, state=wire.PlannerState.RUNNING
        )
        made.session.publish(keys.heartbeat, wire.encode(beat))
        for robot, velocity in velocities.items():
            state = made.watch.states[robot]
            message = wire.Setpoint(
                **header,
                robot_id=robot,
                mission="m1",
                ttl_s=0.5,
                velocity=velocity,
                waypoint=state.position,
                altitude_m=next(r.altitude_m for r in made.scenario.robots if r.id == robot),
            )
            made.session.publish(keys.robot(robot, Topic.SETPOINT), wire.encode(message))
        await asyncio.sleep(PERIOD_S)


def seen(made: Team, invariant: Invariant) -> bool:
    """Tell whether the invariant was seen broken."""
    return bool(made.findings.of(invariant))


async def until_seen(made: Team, invariant: Invariant) -> None:
    """Wait until an invariant is seen broken, or for as long as that may take here."""
    with suppress(AssertionError):
        await until(lambda: seen(made, invariant), CATCH_S * busy())


async def too_fast(made: Team) -> None:
    """A stranger sends a robot faster than it may fly."""
    ghost, until_s = Ghost(made, "fast"), monotonic() + CATCH_S * busy()
    while monotonic() < until_s and not seen(made, Invariant.LIMITS):
        await ghost.fly({25: (0.9, 0.0)})


async def dead_planner_speaks(made: Team) -> None:
    """Setpoints and heartbeats go on after the planner was killed."""
    asked_s, ghost = monotonic(), Ghost(made, "ghost")
    since_s = await killed(made.planner)
    with made.watch.silence(ROBOTS, since_s, dead=True):
        until_s = since_s + CATCH_S * busy()
        while monotonic() < until_s and not seen(made, Invariant.DEAD):
            await ghost.fly(dict.fromkeys(ROBOTS, (0.0, 0.0)))
    # Until then the mission passes for one that flies.
    await made.ear.until(alarmed("planner"), asked_s, "planner killed")


async def no_hold(made: Team) -> None:
    """A vehicle is set up to fly alone for half a minute when its planner is silent."""
    made.extra[APART] = ("--autonomous", "30")
    await killed(made.pid(f"vehicle {APART}"))
    await made.start_vehicle(APART)
    await made.until_flying()
    pid = made.planner
    since_s = await stopped(pid)
    try:
        with made.watch.silence((APART,), since_s, dead=False):
            await asyncio.sleep(HOLD_S)
            await until_seen(made, Invariant.HOLD)
    finally:
        os.kill(pid, signal.SIGCONT)
    del made.extra[APART]
    await killed(made.pid(f"vehicle {APART}"))
    await made.start_vehicle(APART)


async def collision(made: Team) -> None:
    """The planner hangs, and a stranger flies two robots at each other, slowly enough."""
    pid, ghost = made.planner, Ghost(made, "collision")
    await stopped(pid)
    try:
        pair, apart_m = nearest(made)
        until_s = monotonic() + (MEETING_S + 0.5 * apart_m / CLOSING_M_S) * busy()
        while monotonic() < until_s and not seen(made, Invariant.SEPARATION):
            one, other = (made.watch.states[robot].position for robot in pair)
            apart_m = max(math.dist(one, other), 0.01)
            east, north = (CLOSING_M_S * (b - a) / apart_m for a, b in zip(one, other, strict=True))
            await ghost.fly(dict(zip(pair, ((east, north), (-east, -north)), strict=True)))
    finally:
        os.kill(pid, signal.SIGCONT)


def nearest(made: Team) -> tuple[tuple[int, int], float]:
    """Return which two robots of the world's own are nearest, and how far apart: who follows which
    targets is the models' choice."""
    states, watch = made.watch.states, made.watch
    inside = [robot for robot in ROBOTS if robot not in OUTSIDE and not watch.jammed(robot)]
    far_m = {
        pair: math.dist(*(states[robot].position for robot in pair))
        for pair in combinations(inside, 2)
    }
    return min(far_m.items(), key=lambda one: one[1])


async def mad_directive(made: Team) -> None:
    """The stream shows a weight that nobody may ask for."""

    def forge(data: bytes) -> bytes:
        return WEIGHT.sub(lambda m: m[1] + b"-9".ljust(len(m[2])), data)

    made.door.forge = forge
    try:
        await until_seen(made, Invariant.BOUNDS)
    finally:
        made.door.forge = bytes


async def silent_fault(made: Team) -> None:
    """A robot's loss is kept from those who read alarms and events."""

    def forge(data: bytes) -> bytes:
        return LOST.sub(rb'\1"here"', data).replace(b"link-%d" % APART, b"link-99")

    made.door.forge = forge
    made.ear.patience_s = SUPPRESSED_S
    since_s = monotonic()
    made.watch.away.add(APART)
    await killed(made.pid(f"vehicle {APART}"))
    try:
        await made.ear.until(linked(APART, "lost"), since_s, f"robot {APART} killed")
    except Unreported as error:
        made.findings.broken(Invariant.REPORTED, "planted", str(error))
    finally:
        made.door.forge, made.ear.patience_s = bytes, None
    await made.start_vehicle(APART)


async def edited_journal(made: Team) -> None:
    """Somebody changes the author of an entry."""
    await asked(made.database, "edit")
    whole, words = await doctor(made.database)
    if not whole:
        made.findings.broken(Invariant.CHAIN, "planted", words.splitlines()[-1])


async def dropped_comment(made: Team) -> None:
    """Somebody removes an acknowledged comment while the server is down."""
    count = len(made.commenter.acknowledged)
    await until(lambda: len(made.commenter.acknowledged) > count, 60.0 * busy(), "a comment")
    planner = made.planner
    await killed(made.server)
    await made.until_gone(lambda: not lives(planner), "the planner's end")
    # Not simply the newest: the server may have died between its entry and its answer.
    await asked(made.database, "drop", next(reversed(made.commenter.acknowledged)))
    await made.start_server()
    await made.until_flying()
    await made.commenter.compare()


PLANTS: dict[Invariant, Callable[[Team], Awaitable[None]]] = {
    Invariant.LIMITS: too_fast,
    Invariant.DEAD: dead_planner_speaks,
    Invariant.HOLD: no_hold,
    Invariant.SEPARATION: collision,
    Invariant.BOUNDS: mad_directive,
    Invariant.REPORTED: silent_fault,
    Invariant.CHAIN: edited_journal,
    Invariant.COMMENTS: dropped_comment,
}
"""In this order: the last two leave a journal that is not whole."""


async def plant(made: Team, invariant: Invariant) -> Caught:
    """Plant the bug for an invariant in a flying team; return what became of it."""
    bug = PLANTS[invariant]
    made.findings.forget()
    await bug(made)
    await until_seen(made, invariant)  # it may still be on its way to who looks
    violations = made.findings.of(invariant)
    planted = (bug.__doc__ or "").strip()
    await made.until_flying()
    return Caught(invariant, planted, violations[0].text if violations else "")


async def plant_all(show: Callable[[str], None]) -> list[Caught]:
    """Start a team and plant every bug, one after the other; return what became of each."""
    with TemporaryDirectory(prefix="falconer-chaos-") as folder:
        show("starting")
        async with team(Path(folder), 0, "sqlite") as made:
            found = []
            for invariant in PLANTS:
                show(invariant.value)
                found.append(await plant(made, invariant))
            return found
