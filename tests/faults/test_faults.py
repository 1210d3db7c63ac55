"""The fault table: what is broken on purpose, over real processes and sockets, one test each.

All share one team (`tests.faults.rig`), which must fly again by itself after every fault. Robots
21, 22 and 24 are MAVLink vehicles (ArduPilot, PX4, ArduPilot with signing), 23 is simulated by the
world. Seconds are written to the log: `pytest tests/faults -o log_cli=true -o log_cli_level=INFO`.
"""

import asyncio
import logging
import os
import random
import signal
from collections.abc import AsyncIterator
from dataclasses import replace
from time import monotonic

import pytest
import pytest_asyncio

from tests.faults.clock import set_clock
from tests.faults.commands import falconer, memory_kib, python
from tests.faults.links import until
from tests.faults.rig import (
    ARDUPILOT,
    FILE,
    FLYING,
    MOVING_M_S,
    NATIVE,
    PX4,
    SIGNED,
    SPARE,
    STARTED,
    STILL_M_S,
    Team,
    in_flight_s,
    team,
)
from tests.patience import PATIENCE_S, busy, patience_s
from vehicles import messages as wire
from vehicles.keys import Topic
from vehicles.mavlink.dialects import DIALECTS, Autopilot, px4_mode
from vehicles.mavlink.protocol import mavlink

logger = logging.getLogger(__name__)

pytestmark = [
    pytest.mark.process,
    pytest.mark.asyncio(loop_scope="module"),
]

LOITER = (5.0, 0.0)
"""Parameters of the command that changes ArduPilot's mode to LOITER."""

GUIDED = DIALECTS[Autopilot.ARDUPILOT].mode_parameters(4)
POSITION = DIALECTS[Autopilot.PX4].mode_parameters(px4_mode(3))


@pytest_asyncio.fixture(scope="module", loop_scope="module", name="made")
async def _made(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Team]:
    async with team(tmp_path_factory.mktemp("faults")) as made:
        yield made


# ---------------------------------------------------------------------- one vehicle's link


async def test_half_the_packets_lost(made: Team) -> None:
    began_s, link = monotonic(), made.links[ARDUPILOT]
    link.loss = 0.5
    try:
        await asyncio.sleep(5.0)
        await made.still_flying((ARDUPILOT,))
        passed = len(link.since(began_s))
        assert passed > 10 / busy(), "the bridge sends ten a second, whatever arrives"
    finally:
        link.loss = 0.0
    assert made.witness.notices(ARDUPILOT, "link_lost", began_s) == []
    logger.info("50 %% loss: %d setpoints sent in 5 s, flying", passed)


async def test_a_wrong_system_id_is_not_listened_to(made: Team) -> None:
    began_s, link = monotonic(), made.links[ARDUPILOT]
    liar = mavlink.MAVLink(None, srcSystem=99, srcComponent=1)
    far = mavlink.MAVLink_local_position_ned_message(1, 5000.0, 5000.0, -2.0, 0.0, 0.0, 0.0)
    landed = mavlink.MAVLink_heartbeat_message(2, 3, 0, 9, 3, 3)
    for _ in range(40):
        link.to_bridge(far.pack(liar) + landed.pack(liar))
        await asyncio.sleep(0.05)
        assert abs(made.witness.states[ARDUPILOT].position[0]) < 50.0
    await made.still_flying((ARDUPILOT,))
    # A busy planner may have let it hold for a moment; nobody landed it.
    modes = {one.mode for one in made.witness.modes(ARDUPILOT, began_s)}
    assert modes <= {wire.Mode.HOLDING, wire.Mode.FLYING}
    await until(lambda: made.witness.notices(ARDUPILOT, "stranger"), PATIENCE_S, "the notice")
    assert len(made.witness.notices(ARDUPILOT, "stranger")) == 1


async def test_a_flood_on_the_link_changes_nothing(made: Team) -> None:
    """Sound frames of its own vehicle and noise, some two thousand a second."""
    link, dice = made.links[ARDUPILOT], random.Random(1)
    own = mavlink.MAVLink(None, srcSystem=ARDUPILOT, srcComponent=1)
    attitude = mavlink.MAVLink_attitude_message(1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    before_kib = memory_kib(made.bridges[ARDUPILOT].process.pid)
    began_s, sent = monotonic(), 0
    while monotonic() - began_s < 3.0:
        for _ in range(20):
            link.to_bridge(attitude.pack(own) if sent % 2 else dice.randbytes(40))
            sent += 1
        await asyncio.sleep(0.01)
    await made.still_flying((ARDUPILOT,))
    assert made.bridges[ARDUPILOT].alive
    grown_kib = memory_kib(made.bridges[ARDUPILOT].process.pid) - before_kib
    assert grown_kib < 30_000
    logger.info("flood of %d datagrams in 3 s: flying, %d KiB more", sent, grown_kib)


# ---------------------------------------------------------------------- the autopilot's own mind


async def test_a_pilot_takes_over_and_gives_back(made: Team) -> None:
    began_s, link = monotonic(), made.links[ARDUPILOT]
    link.change_mode(ARDUPILOT, LOITER)
    await until(lambda: made.witness.mode(ARDUPILOT) is wire.Mode.MANUAL, PATIENCE_S, "let go")
    let_go_s = monotonic() - began_s
    told_s = monotonic() + in_flight_s()
    await made.until_held((ARDUPILOT,), patience_s())
    await asyncio.sleep(1.0)
    assert link.since(told_s) == [], "the bridge lets go at once and stays away"
    link.change_mode(ARDUPILOT, GUIDED)
    back_s = await made.until_flying((ARDUPILOT,))
    await until(lambda: made.witness.notices(ARDUPILOT, "control", began_s), PATIENCE_S, "control")
    (pilot,) = made.witness.notices(ARDUPILOT, "pilot", began_s)
    assert pilot == "a pilot changed the mode to LOITER"
    assert len(made.witness.notices(ARDUPILOT, "control", began_s)) == 1
    logger.info("pilot: let go after %.2f s, flies on %.2f s after GUIDED", let_go_s, back_s)


async def test_a_refused_mode_and_a_battery_that_runs_out(made: Team) -> None:
    """The spare vehicle refuses to come back to GUIDED; another run of it runs out of battery."""
    stubborn = replace(made.autopilots[SPARE], extra=("--refuse", "GUIDED"))
    autopilot, _ = await asyncio.gather(
        made.fleet.start("stubborn", stubborn.command(), "at udpin"), made.start_bridge(SPARE)
    )
    await made.until_flying((SPARE,))
    began_s, link = monotonic(), made.links[SPARE]
    link.change_mode(SPARE, LOITER)
    await until(lambda: made.witness.mode(SPARE) is wire.Mode.MANUAL, PATIENCE_S, "let go")
    code, words = await falconer(
        "vehicle", "order", "resume", "--robot", str(SPARE), "--scenario", str(FILE),
        "--zenoh-connect", made.bus,
    )  # fmt: skip
    assert code == 1, words
    assert f"robot {SPARE} refuses" in words
    await asyncio.sleep(1.0)
    refused = made.witness.notices(SPARE, "refused", began_s)
    assert sum("GUIDED" in words for words in refused) == 1, refused
    await until(lambda: made.witness.mode(SPARE) is wire.Mode.MANUAL, PATIENCE_S, "still let go")
    assert link.heard.speed_m_s < STILL_M_S
    await autopilot.end()
    # It flies for eight seconds before its failsafe: by then the bridge must have taken it over.
    weak = replace(stubborn, extra=("--battery", "0.29", "--battery-life", "60"))
    began_s = monotonic()
    autopilot = await made.fleet.start("weak", weak.command(), "at udpin")
    await until(
        lambda: made.witness.notices(SPARE, "failsafe", began_s), PATIENCE_S, "the failsafe"
    )
    await until(lambda: made.witness.mode(SPARE) is wire.Mode.RETURNING, PATIENCE_S, "returning")
    told_s = monotonic() + in_flight_s()
    await asyncio.sleep(1.5)
    assert link.since(told_s) == [], "the bridge does not fight a failsafe"
    assert len(made.witness.notices(SPARE, "failsafe", began_s)) == 1
    assert len(made.witness.notices(SPARE, "battery", began_s)) == 1
    assert made.bridges[SPARE].alive
    await made.bridges[SPARE].end()
    await autopilot.end()
    await made.still_flying()


# ---------------------------------------------------------------------- one vehicle's process


async def test_a_killed_vehicle_is_lost_at_once_and_comes_back(made: Team) -> None:
    began_s, lost = monotonic(), f"Robot {SIGNED} is lost"
    before = len(made.planner.told(lost))
    made.bridges[SIGNED].send(signal.SIGKILL)
    await until(lambda: len(made.planner.told(lost)) > before, PATIENCE_S, "lost")
    lost_s = monotonic() - began_s
    assert lost_s < patience_s()
    held_s = lost_s + await made.until_held((SIGNED,), patience_s())
    await made.start_bridge(SIGNED)
    await made.until_flying((SIGNED,))
    assert len(made.planner.told(lost)) == before + 1
    logger.info("vehicle killed: lost after %.2f s, stopped by itself after %.2f s", lost_s, held_s)


async def test_a_second_agent_of_one_robot_does_not_start(made: Team) -> None:
    began_s, both = monotonic(), (NATIVE, ARDUPILOT)
    ends = await asyncio.gather(
        *(
            falconer(
                "vehicle", "mavlink", "--robot", str(robot_id), "--connect", "udpin:127.0.0.1:0",
                "--scenario", str(FILE), "--zenoh-connect", made.bus,
            )
            for robot_id in both
        )
    )  # fmt: skip
    for robot_id, (code, words) in zip(both, ends, strict=True):
        assert code == 2
        assert f"robot {robot_id} of team faults is flown by another agent" in words
        assert "Traceback" not in words
        assert made.witness.notices(robot_id, "duplicate", began_s) == []
    await made.still_flying(both)


async def test_who_speaks_under_a_robots_id_makes_it_hold(made: Team) -> None:
    began_s = monotonic()
    key = made.witness.keys.robot(ARDUPILOT, Topic.STATE)

    async def speak() -> None:
        for seq in range(15):
            state = made.witness.states[ARDUPILOT].model_copy(update={"boot": "x", "seq": seq})
            made.session.publish(key, wire.encode(state))
            await asyncio.sleep(0.1)

    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(speak())
        held_s = await made.until_held((ARDUPILOT,), patience_s())
    silent_s = monotonic()
    await made.until_flying((ARDUPILOT,))
    assert len(made.witness.notices(ARDUPILOT, "duplicate", began_s)) == 1
    back_s = monotonic() - silent_s
    logger.info("duplicate: still after %.2f s, flies %.2f s after its silence", held_s, back_s)


async def test_one_of_two_links_lost(made: Team) -> None:
    first, second = made.bus_links
    used, spare = (first, second) if first.used else (second, first)
    assert used.used
    assert not spare.used
    began_s = monotonic()
    await made.cut(used)
    await until(lambda: spare.used, PATIENCE_S, "the other link")
    over_s = monotonic() - began_s
    await asyncio.sleep(1.0)
    await made.still_flying((PX4,))
    await used.heal()
    holds = sum(one.mode is wire.Mode.HOLDING for one in made.witness.modes(PX4, began_s))
    logger.info("one of two links lost: on the other after %.2f s, held %d times", over_s, holds)
    made.witness.check_once()


# ---------------------------------------------------------------------- the team's clocks and bus


@pytest.mark.parametrize("offset_s", [3600.0, -3600.0])
async def test_a_wall_clock_that_jumps_an_hour(made: Team, offset_s: float) -> None:
    began_s, ticks = monotonic(), made.planner.ticks[0]
    set_clock(made.clock_file, offset_s)
    try:
        code, words = await python("import time; print(time.time())", made.environment)
        shown_s = float(words)
        assert code == 0
        await until(lambda: made.planner.ticks[0] - ticks >= 30, PATIENCE_S, "the planner's ticks")
    finally:
        set_clock(made.clock_file, 0.0)
    _, words = await python("import time; print(time.time())", made.environment)
    jump_s = shown_s - float(words)
    assert jump_s == pytest.approx(offset_s, abs=60.0), "the clock did jump"
    await made.still_flying()
    for robot_id in FLYING:
        for code_ in ("link_lost", "refused"):
            assert made.witness.notices(robot_id, code_, began_s) == []


async def test_a_flood_on_the_bus_brings_nobody_down(made: Team) -> None:
    """Sound and malformed messages on every kind of key, some two thousand a second."""
    keys, dice, began_s, sent = made.witness.keys, random.Random(2), monotonic(), 0
    sound = made.witness.states[NATIVE].model_copy(update={"robot_id": 99, "boot": "flood"})
    event = wire.Event(
        v=1, boot="flood", seq=0, stamp_s=0.0, robot_id=99, age_s=0.0,
        event=wire.NoticePart(code="flood", text="x" * 200),
    )  # fmt: skip
    before_kib = memory_kib(made.planner.pid)
    ticks = sum(made.planner.ticks)
    while monotonic() - began_s < 3.0:
        for _ in range(10):
            sent += 2
            update = {"seq": sent}
            made.session.publish(
                keys.robot(99, Topic.STATE), wire.encode(sound.model_copy(update=update))
            )
            made.session.publish(
                keys.robot(99, Topic.EVENTS), wire.encode(event.model_copy(update=update))
            )
        for topic in (Topic.KNOWLEDGE, Topic.COMMAND, Topic.EVENTS, Topic.DETECTIONS):
            sent += 1
            made.session.publish(keys.robot(ARDUPILOT, topic), dice.randbytes(200))
        made.session.publish(keys.external(ARDUPILOT, Topic.INCIDENTS), b"{")
        made.session.publish(keys.control, b"[]")
        await asyncio.sleep(0.01)
    await made.still_flying()
    await until(lambda: sum(made.planner.ticks) - ticks >= 25, PATIENCE_S, "the planner's ticks")
    grown_kib = memory_kib(made.planner.pid) - before_kib
    assert grown_kib < 50_000
    await until(lambda: made.planner.told("robot 99"), PATIENCE_S, "the notice")
    assert len(made.planner.told("robot 99: not of this team")) == 1
    logger.info("flood of %d messages in 3 s: all fly, planner %d KiB more", sent, grown_kib)


async def test_a_flood_of_setpoints_that_are_none_ends_in_holding(made: Team) -> None:
    """They displace the planner's: the vehicle must hold, and fly on when they stop."""
    key, began_s = made.witness.keys.robot(ARDUPILOT, Topic.SETPOINT), monotonic()

    def holds() -> bool:
        changes = made.witness.modes(ARDUPILOT, began_s)
        return any(one.mode is wire.Mode.HOLDING for one in changes)

    while not holds():
        assert monotonic() - began_s < PATIENCE_S, "it follows through the flood"
        for _ in range(20):
            made.session.publish(key, b'{"v":1,"velocity":[1e999,0]}')
        await asyncio.sleep(0.01)
    assert made.bridges[ARDUPILOT].alive
    back_s = await made.until_flying((ARDUPILOT,))
    await made.has_told_of_holding(began_s, (ARDUPILOT,))
    logger.info("flood of setpoints: flies on %.2f s after it", back_s)


# ---------------------------------------------------------------------- the planner


async def test_a_hung_planner_stops_the_team_and_goes_on(made: Team) -> None:
    began_s = monotonic()
    os.kill(made.planner.pid, signal.SIGSTOP)
    try:
        held_s = await _all_held(made)
        await _stays_held(made, monotonic() + 1.5)
    finally:
        os.kill(made.planner.pid, signal.SIGCONT)
    back_s = await made.until_flying()
    await made.has_told_of_holding(began_s, FLYING)
    logger.info("planner hung: all hold after %.2f s, fly on after %.2f s", held_s, back_s)


async def test_a_killed_planner_stops_the_team_and_another_flies_it(made: Team) -> None:
    began_s = monotonic()
    await made.planner.end(signal.SIGKILL)
    held_s = await _all_held(made)
    await made.planner.start()
    back_s = await made.until_flying()
    await made.has_told_of_holding(began_s, FLYING)
    logger.info("planner killed: all hold after %.2f s, fly %.2f s after a new one", held_s, back_s)


# ---------------------------------------------------------------------- the router


@pytest.mark.parametrize("outage_s", [1.0, 12.0])
async def test_a_router_that_dies_and_comes_back(made: Team, outage_s: float) -> None:
    began_s = monotonic()
    made.kill_router()
    try:
        held_s = await made.until_held(STARTED, patience_s())
        await _stays_held(made, began_s + outage_s)
    finally:
        await made.start_router()
    back_s = await made.until_flying()
    await made.has_told_of_holding(began_s, FLYING)
    logger.info(
        "router dead %.0f s: held after %.2f s, fly %.2f s after it", outage_s, held_s, back_s
    )


# ---------------------------------------------------------------------- helpers


async def _all_held(made: Team) -> float:
    """Wait until the whole team stands still and says so; return how long it took."""
    held_s = await made.until_held(STARTED, patience_s())
    native_s = await until(
        lambda: made.witness.speed_m_s(NATIVE) == 0.0, patience_s(), "robot 23 holds"
    )
    said_s = await until(
        lambda: all(made.witness.mode(i) is wire.Mode.HOLDING for i in FLYING),
        PATIENCE_S,
        "it is said",
    )
    logger.info("  still after %.2f s, said %.2f s later", held_s + native_s, said_s)
    return held_s + native_s


async def _stays_held(made: Team, until_s: float) -> None:
    """Fail when a vehicle is told to move, or moves, before a moment."""
    from_s = monotonic() + in_flight_s()
    while monotonic() < until_s:
        for robot_id in STARTED:
            link = made.links[robot_id]
            assert {speed for _, speed in link.since(from_s)} <= {0.0}, robot_id
            assert link.heard.speed_m_s < MOVING_M_S, robot_id
        await asyncio.sleep(0.05)
