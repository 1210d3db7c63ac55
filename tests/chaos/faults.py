"""The faults: each is done to the team, seen to be reported, and undone.

A fault returns the words by which people were told of it. It raises `Unreported` where nobody was,
and AssertionError where something else that it looks for did not happen.
"""

import asyncio
import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from time import monotonic

import httpx

from llm.mock.behaviours import Mode
from server.gate.decisions import Refuser
from solver.directives import Source
from tests.chaos.clients import api
from tests.chaos.ear import Told, Unreported, alarmed, linked, noticed, over
from tests.chaos.journals import Lite, asked
from tests.chaos.processes import killed, lives, planner_of, stopped
from tests.chaos.schedule import Strike
from tests.chaos.team import ADMIN, ROBOTS, Team, bearer
from tests.chaos.watch import Invariant
from tests.faults.clock import set_clock
from tests.faults.links import until
from tests.patience import HOLD_S, busy

LLM_DELAY_S = 12.0
"""Longer than a hosted model may take."""

REQUESTS = 3000
AT_ONCE = 50
MODELS = frozenset({Source.TASK_LLM, Source.ACTION_LLM})
MODELS_FAULTS = frozenset({Refuser.NO_ANSWER, Refuser.PARSING, Refuser.VERIFICATION})


def flown(team: Team) -> tuple[int, ...]:
    """Return the robots that nothing else is wrong with."""
    return tuple(robot for robot in ROBOTS if robot not in team.watch.away)


@asynccontextmanager
async def silence(team: Team, since_s: float, seconds: float, *, dead: bool) -> AsyncIterator[None]:
    """Let the team be without a planner for a while, and see that autopilots are told to stand."""
    with team.watch.silence(flown(team), since_s, dead=dead):
        yield
        late_s = 0.15 * busy()
        while monotonic() < since_s + max(seconds, HOLD_S + late_s + 1.0):
            for robot, link in team.links.items():
                if robot in team.watch.away or team.watch.jammed(robot):
                    continue
                team.findings.looked(Invariant.HOLD)
                from_s = team.watch.left_alone_s(robot, since_s) + HOLD_S + late_s
                moving = [speed for _, speed in link.since(from_s) if speed > 0.0]
                if moving:
                    words = f"autopilot {robot} is told to fly {moving[0]:.2f} m/s in the silence"
                    team.findings.broken(Invariant.HOLD, f"autopilot {robot}", words)
            await asyncio.sleep(0.05)


def held(told: Told) -> bool:
    """Recognise that a robot told why it held."""
    return noticed("mode", words="holding")(told) or told.data.get("link") in ("lost", "jammed")


# ---------------------------------------------------------------------- vehicles


async def kill_vehicle(team: Team, strike: Strike) -> str:
    """Kill what flies a robot; start it again."""
    robot, since_s = strike.robot, monotonic()
    team.watch.away.add(robot)
    await killed(team.pid(f"vehicle {robot}"))
    told = await team.ear.until(linked(robot, "lost"), since_s, f"robot {robot} killed")
    await team.start_vehicle(robot)
    return told.text


async def stop_vehicle(team: Team, strike: Strike) -> str:
    """Stop what flies a robot, and let it go on."""
    robot, since_s = strike.robot, monotonic()
    team.watch.away.add(robot)
    pid = team.pid(f"vehicle {robot}")
    await stopped(pid)
    try:
        told = await team.ear.until(linked(robot, "lost", "jammed"), since_s, f"robot {robot}")
        await asyncio.sleep(strike.seconds)
    finally:
        os.kill(pid, signal.SIGCONT)
    return told.text


async def start_twice(team: Team, strike: Strike) -> str:
    """Start a second agent of a robot: it must not fly."""
    intruder = await team.launch_vehicle(strike.robot)
    await until(lambda: not intruder.alive, 40.0 * busy(), "the second agent ends")
    await intruder.end()
    words = f"robot {strike.robot} of team chaos is flown by another agent"
    assert intruder.process.returncode == 2, intruder.log
    assert words in intruder.log, intruder.log
    return f"exit code 2: {words}"


# ---------------------------------------------------------------------- planner and server


async def kill_planner(team: Team, strike: Strike) -> str:
    """Kill the planner's process alone."""
    asked_s, pid = monotonic(), team.planner
    since_s = await killed(pid)
    async with silence(team, since_s, strike.seconds, dead=True):
        told = await team.ear.until(alarmed("planner"), asked_s, "planner killed")
    await team.order("start")
    return told.text


async def stop_planner(team: Team, strike: Strike) -> str:
    """Stop the planner, and let it go on."""
    asked_s, pid = monotonic(), team.planner
    since_s = await stopped(pid)
    try:
        async with silence(team, since_s, strike.seconds, dead=True):
            pass
    finally:
        os.kill(pid, signal.SIGCONT)
    return (await team.ear.until(held, asked_s, "planner stopped")).text


async def slow_planner(team: Team, strike: Strike) -> str:
    """Let the planner run half of the time, a quarter of a second each."""
    pid, before = team.planner, team.ear.snapshot["loops"]["optimizer"]["missed"]
    until_s = monotonic() + strike.seconds
    try:
        while monotonic() < until_s:
            os.kill(pid, signal.SIGSTOP)
            await asyncio.sleep(0.25)
            os.kill(pid, signal.SIGCONT)
            await asyncio.sleep(0.25)
    finally:
        os.kill(pid, signal.SIGCONT)

    def missed() -> int:
        now: int = team.ear.snapshot["loops"]["optimizer"]["missed"]
        return now - int(before)

    await team.until_gone(lambda: missed() > 0, "missed ticks are counted")
    return f"{missed()} ticks counted as missed"


async def kill_server(team: Team, strike: Strike) -> str:
    """Kill the server; its planner must go with it, and the mission come up held."""
    asked_s, pid = monotonic(), team.planner
    await killed(team.server)
    await team.until_gone(lambda: planner_of(team.server) is None and not lives(pid), "no orphan")
    async with silence(team, monotonic(), strike.seconds, dead=True):
        pass
    began_s = monotonic()
    await team.start_server()
    told = await team.ear.until(alarmed("interruption"), began_s, f"killed at {asked_s:.1f}")
    await team.commenter.compare()
    return told.text


# ---------------------------------------------------------------------- router and networks


async def kill_router(team: Team, strike: Strike) -> str:
    """Kill the router, and start another."""
    asked_s = monotonic()
    since_s = await killed(team.pid("router"))
    async with silence(team, since_s, strike.seconds, dead=False):
        pass
    await team.start_router()
    return (await team.ear.until(held, asked_s, "router killed")).text


async def stop_router(team: Team, strike: Strike) -> str:
    """Stop the router, and let it go on."""
    asked_s = monotonic()
    since_s = await stopped(team.pid("router"))
    try:
        async with silence(team, since_s, strike.seconds, dead=False):
            pass
    finally:
        os.kill(team.pid("router"), signal.SIGCONT)
    return (await team.ear.until(held, asked_s, "router stopped")).text


async def cut_network(team: Team, strike: Strike) -> str:
    """Cut the server off the bus, and heal the way."""
    asked_s = monotonic()
    await team.trunk.cut()
    try:
        async with silence(team, monotonic(), strike.seconds, dead=False):
            pass
    finally:
        await team.trunk.heal()
    return (await team.ear.until(held, asked_s, "network cut")).text


async def lose_mavlink(team: Team, strike: Strike) -> str:
    """Lose every datagram between a bridge and its autopilot."""
    link, since_s = team.links[strike.robot], monotonic()
    team.watch.away.add(strike.robot)
    link.loss = 1.0
    try:
        told = await team.ear.until(noticed("link_lost", strike.robot), since_s, "MAVLink lost")
    finally:
        link.loss = 0.0
    return told.text


# ---------------------------------------------------------------------- language model


def complained(told: Told) -> bool:
    """Recognise that an answer of a model was refused, or did not come."""
    card = told.data.get("decision") or {}
    return (
        (told.kind == "verdict" and "loop" in told.data)
        or (card.get("source") in MODELS and card.get("refused_by") in MODELS_FAULTS)
        or (told.kind == "loop" and told.severity != "info")
    )


def answered(told: Told) -> bool:
    """Recognise that a model gave a valid answer, whatever came of it."""
    card = told.data.get("decision") or {}
    return card.get("source") in MODELS and card.get("refused_by") not in MODELS_FAULTS


async def garble_llm(team: Team, strike: Strike) -> str:
    """Let the model answer garbage of one kind."""
    return await _misbehave(team, strike.mode)


async def slow_llm(team: Team, strike: Strike) -> str:
    """Let the model answer too late."""
    return await _misbehave(team, Mode.SLOW)


async def kill_llm(team: Team, strike: Strike) -> str:
    """Kill the model's server, and start another."""
    since_s = monotonic()
    await killed(team.pid("llm"))
    told = await team.ear.until(complained, since_s, "model killed")
    await team.start_llm()
    await team.ear.until(answered, monotonic(), "the model answers again")
    return told.text


async def _misbehave(team: Team, mode: Mode) -> str:
    since_s = monotonic()
    await team.behave(mode.value, LLM_DELAY_S)
    try:
        told = await team.ear.until(complained, since_s, f"model is {mode.value}")
    finally:
        await team.behave(Mode.SOUND.value)
    # What is said of the next fault must not be what is still said of this one.
    await team.ear.until(answered, monotonic(), "the model answers again")
    return told.text


# ---------------------------------------------------------------------- journal and clock


async def fill_disk(team: Team, strike: Strike) -> str:
    """Leave no room for the journal, and make room again."""
    assert isinstance(team.database, Lite)
    await asked(team.database, "tidy")
    team.disk.fill(team.server)
    try:
        return await _journal_gone(team, f"full {team.disk.kind}")
    finally:
        team.disk.free(team.server)
        await _journal_back(team)


async def take_database(team: Team, strike: Strike) -> str:
    """Take the database away, and give it back."""
    await team.database.take_away()
    try:
        return await _journal_gone(team, "database gone")
    finally:
        await team.database.give_back()
        await _journal_back(team)


async def _journal_gone(team: Team, what: str) -> str:
    since_s, refused = monotonic(), len(team.commenter.refused)
    told = await team.ear.until(alarmed("journal"), since_s, what)
    await team.until_gone(
        lambda: "journal_unavailable" in team.commenter.refused[refused:],
        "comments are refused while there is no journal",
    )
    return told.text


async def _journal_back(team: Team) -> None:
    with suppress(StopIteration):
        at_s = next(t.at_s for t in reversed(team.ear.told) if alarmed("journal")(t))
        await team.ear.until(over("journal"), at_s, "the journal is back")


async def jump_clock(team: Team, strike: Strike) -> str:
    """Let the server's wall clock jump, and jump back."""
    since_s = monotonic()
    set_clock(team.clock_file, strike.offset_s)
    try:
        return (await team.ear.until(alarmed("clock"), since_s, "clock jumped")).text
    finally:
        set_clock(team.clock_file, 0.0)


# ---------------------------------------------------------------------- flood of requests


async def flood_api(team: Team, strike: Strike) -> str:
    """Ask more than anybody may; Hold is never refused."""
    sent = refused = 0
    async with api(team.web, bearer(ADMIN)) as http:

        async def ask() -> int:
            with suppress(httpx.HTTPError):
                return int((await http.get("/missions/m1/decisions?limit=1")).status_code)
            return 0

        while sent < REQUESTS and not refused:
            sent += AT_ONCE
            refused += (await asyncio.gather(*(ask() for _ in range(AT_ONCE)))).count(429)
        code = (await http.post("/missions/m1/hold", timeout=60.0)).status_code
    assert code < 300, f"Hold was answered with {code}"
    if not refused:
        raise Unreported(f"{sent} requests at once, and none was refused")
    return f"{refused} of {sent} requests answered with 429, Hold with {code}"
