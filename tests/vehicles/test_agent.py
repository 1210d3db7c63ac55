"""The agent against a planner and a world, in virtual time."""

import json
from dataclasses import replace

import pytest

from solver.observations import Attack, Detections, RobotState, TrackReport
from solver.zones import ZoneKind
from tests.vehicles.buses import KEYS
from tests.vehicles.pilots import INFERENCE, Recorder, knowledge
from tests.vehicles.rigs import TICK_S, rig
from tests.vehicles.samples import SAMPLES
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles import messages as wire
from vehicles.agent import DuplicateRobotError
from vehicles.keys import Topic
from vehicles.local_bus import LocalBus
from vehicles.onboard import OnboardPilot
from vehicles.repetition import MOST
from vehicles.settings import AgentSettings, SimulationSettings
from vehicles.simulation import Simulation
from vehicles.world.setup import Discovery, WorldSetup, WorldTarget, WorldZone

TARGET = WorldTarget(122, (3.0, 4.0))
PAIR = world_setup((robot(21, 0.0), robot(26, 5.0)), (TARGET,))

pytestmark = pytest.mark.asyncio


def dense(kind: ZoneKind, x: float = 0.0) -> WorldZone:
    """A zone that always hits in its centre and is over half a metre off."""
    return zone("z1", kind, (x, 0.0), ((0.01, 0.0), (0.0, 0.01)), margin=0.0)


def hazardous(kind: ZoneKind) -> WorldSetup:
    return replace(PAIR, zones=(dense(kind),), attack_period_s=0.1)


def jamming_ahead() -> WorldSetup:
    return replace(PAIR, zones=(dense(ZoneKind.COMMUNICATION, 0.5),), attack_period_s=0.01)


# ---------------------------------------------------------------------- planner and silence


async def test_setpoints_are_flown_and_told() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (0.5, 0.0), 26: (0.0, -0.2)}
        await made.tick(11)
        assert made.position(21) == pytest.approx((0.5, 0.0))
        assert made.position(26) == pytest.approx((5.0, -0.2))
        states = [s for s in await made.tick() if isinstance(s, RobotState)]
        assert {state.robot_id: state.velocity for state in states} == made.velocities
        assert made.links() == [(21, "connected"), (26, "connected")]


async def test_without_the_planner_every_vehicle_holds_within_a_second_and_then_resumes() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (0.5, 0.0), 26: (0.0, -0.2)}
        await made.tick(10)
        await made.tick(6, planner="dead")
        assert made.velocity(21) == made.velocity(26) == (0.0, 0.0)
        where = made.position(21)
        await made.tick(50, planner="dead")
        assert made.position(21) == where
        await made.tick(3)
        assert made.velocity(21) == (0.5, 0.0)
        modes = [n.text for n in made.notices if n.robot_id == 21 and n.code == "mode"]
        assert [text.split(":")[0] for text in modes] == ["flying", "holding", "flying"]
        assert "no planner is heard" in modes[1] or "expired" in modes[1]


async def test_a_setpoint_lives_as_long_as_it_says_on_the_vehicles_clock() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (0.5, 0.0)}
        await made.tick(2)
        made.velocities = {}
        await made.tick(5)
        assert made.velocity(21) == (0.5, 0.0)
        await made.tick(1)
        assert made.velocity(21) == (0.0, 0.0), "the planner lives, but says nothing to it"


async def test_it_flies_alone_without_a_planner_only_for_as_long_as_it_may() -> None:
    async with rig(PAIR, AgentSettings(autonomous_s=1.0)) as made:
        await made.tick(2)
        made.tell(21)
        await made.tick(2)
        await made.tick(10, planner="dead")
        assert made.velocity(21) == (0.1, 0.0), "the recorder's plan"
        assert made.velocity(26) == (0.0, 0.0), "never told anything"
        await made.tick(12, planner="dead")
        assert made.velocity(21) == (0.0, 0.0)


# ---------------------------------------------------------------------- failures


async def test_a_jammed_robot_flies_alone_and_brings_back_what_it_knows() -> None:
    async with rig(hazardous(ZoneKind.COMMUNICATION)) as made:
        made.velocities = {21: (0.0, 0.0), 26: (0.0, 0.0)}
        before = await made.tick()
        assert [s.robot_id for s in before if isinstance(s, RobotState)] == [26]
        await made.tick(20)
        assert (21, "jammed") in made.links()
        assert not [o for o in made.observed if isinstance(o, Attack)], "nobody could hear it"
        assert made.recorder.problems == [], "it was never told what to fly by"
        assert made.velocity(21) == (0.0, 0.0)


async def test_jammed_in_flight_it_goes_on_by_its_own_plan_until_it_is_out() -> None:
    setup = jamming_ahead()
    async with rig(setup) as made:
        made.velocities = {21: (1.0, 0.0)}
        await made.tick()
        made.tell(21, zones=())
        await made.tick(3)
        assert made.links() == [(21, "connected"), (26, "connected")]
        silent: list[float] = []
        while (21, "jammed") not in made.links():
            silent.append(made.time_s)
            await made.tick()
        assert made.velocity(21) == (0.1, 0.0)
        assert made.recorder.problems[-1].communication.centres.tolist() == [[0.5, 0.0]]
        heard: list[object] = []
        for _ in range(100):
            heard = list(await made.tick())
            if any(isinstance(o, TrackReport) for o in heard):
                break
        assert made.links()[-1] == (21, "connected")
        kinds = [type(o).__name__ for o in heard]
        assert kinds.index("Attack") < kinds.index("TrackReport") < kinds.index("RobotState")
        attacks = [o for o in heard if isinstance(o, Attack)]
        assert len(attacks) == made.simulation.world.hits(ZoneKind.COMMUNICATION)
        assert attacks[0].zone == setup.zones[0].zone
        assert attacks[0].time_s < made.time_s - 0.5
        (report,) = [o for o in heard if isinstance(o, TrackReport)]
        assert report.zones == (setup.zones[0].zone,)
        assert {track.target_id for track in report.tracks} == {122, 124}
        modes = [n.text for n in made.notices if n.robot_id == 21 and n.code == "mode"]
        assert "onboard: jammed: flying alone" in modes
        await made.tick(3)
        assert made.velocity(21) == (1.0, 0.0), "the planner's again"


async def test_what_jams_it_is_inferred_on_board_where_nothing_reveals_it() -> None:
    async with rig(replace(jamming_ahead(), discovery=Discovery.INFERRED)) as made:
        made.velocities = {21: (1.0, 0.0)}
        await made.tick()
        made.tell(21, zones=(), rules=replace(knowledge(21).rules, inference=INFERENCE))
        while (21, "jammed") not in made.links():
            await made.tick()
        await made.tick(5)
        ((x, y),) = made.recorder.problems[-1].communication.centres
        assert 0.2 < x < 2.0
        assert abs(y) < 0.5


async def test_a_silent_planner_is_not_taken_for_jamming() -> None:
    async with rig(PAIR, AgentSettings(autonomous_s=2.0)) as made:
        await made.tick(2)
        made.tell(21, zones=(), rules=replace(knowledge(21).rules, inference=INFERENCE))
        await made.tick(2)
        await made.tick(15, planner="dead")
        assert made.velocity(21) == (0.1, 0.0), "it flies alone"
        assert made.recorder.problems[-1].communication.centres.shape == (0, 2)


async def test_a_sensing_failure_silences_the_sensor_and_not_the_robot() -> None:
    async with rig(hazardous(ZoneKind.SENSING)) as made:
        await made.tick(2)
        for robot_id in (21, 26):
            made.tell(robot_id, targets=(122,))
        heard = await made.tick(3)
        seen = {o.robot_id for o in heard if isinstance(o, Detections)}
        assert seen == {26}
        states = {o.robot_id: o for o in heard if isinstance(o, RobotState)}
        assert states[21].sensing_failed
        assert not states[26].sensing_failed
        attacks = [o for o in made.observed if isinstance(o, Attack)]
        assert {(a.robot_id, a.kind) for a in attacks} == {(21, ZoneKind.SENSING)}
        assert attacks[0].zone == made.simulation.setup.zones[0].zone
        assert len(attacks) >= made.simulation.world.hits(ZoneKind.SENSING) - 1
        made.velocities = {21: (0.0, 1.0)}
        await made.tick(8)
        assert "sensing works again" in [notice.text for notice in made.notices]


async def test_only_assigned_targets_are_looked_at() -> None:
    two = replace(PAIR, targets=(TARGET, WorldTarget(124, (1.0, 1.0))))
    async with rig(two) as made:
        assert not [o for o in await made.tick(2) if isinstance(o, Detections)]
        made.tell(21, targets=(124,))
        heard = [o for o in await made.tick(2) if isinstance(o, Detections)]
        assert [s.target_id for d in heard for s in d.sightings] == [124] * len(heard)
        assert heard


# ---------------------------------------------------------------------- orders


async def test_an_order_goes_before_setpoints_until_it_is_lifted() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (1.0, 0.0)}
        await made.tick(11)
        made.order(21, wire.Order.RETURN)
        await made.tick(20)
        assert made.position(21)[0] < 0.3
        await made.tick(40)
        assert made.position(21) == pytest.approx((0.0, 0.0), abs=0.06)
        assert made.velocity(21) == (0.0, 0.0)
        texts = [n.text for n in made.notices if n.robot_id == 21]
        assert "returning: ordered to return" in texts
        assert "at home" in texts
        made.order(21, wire.Order.RESUME)
        await made.tick(3)
        assert made.velocity(21) == (1.0, 0.0)


async def test_landing_taking_off_and_what_makes_no_sense() -> None:
    async with rig(PAIR) as made:
        await made.tick(2)
        made.order(26, wire.Order.TAKE_OFF)
        made.order(21, wire.Order.LAND)
        await made.tick(250)
        assert made.simulation.world.robot_state(21).altitude_m < 0.05
        made.velocities = {21: (1.0, 0.0)}
        made.order(21, wire.Order.RETURN)
        await made.tick(5)
        assert made.velocity(21) == (0.0, 0.0), "on the ground it goes nowhere"
        made.order(21, wire.Order.TAKE_OFF)
        await made.tick(250)
        altitude = made.simulation.setup.robots[0].altitude_m
        assert made.simulation.world.robot_state(21).altitude_m == pytest.approx(altitude, abs=0.06)
        told = [(n.robot_id, n.code, n.text) for n in made.notices if n.code != "mode"]
        assert told == [
            (26, "refused", "take_off: in the air"),
            (21, "done", "landed"),
            (21, "refused", "return: on the ground"),
            (21, "done", "in the air"),
        ]


async def test_a_take_off_that_is_refused_at_once_changes_nothing() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (0.5, 0.0), 26: (0.5, 0.0)}
        await made.tick(3)
        made.order(26, wire.Order.HOLD)
        await made.tick(2)
        for robot_id in (21, 26):
            made.order(robot_id, wire.Order.TAKE_OFF)
        await made.tick(10)
        refusals = [(n.robot_id, n.text) for n in made.notices if n.code == "refused"]
        assert refusals == [(21, "take_off: in the air"), (26, "take_off: in the air")]
        assert made.velocity(21) == (0.5, 0.0), "it flies on"
        assert made.velocity(26) == (0.0, 0.0), "it was ordered to hold, and still is"


async def test_an_order_heard_twice_is_obeyed_once() -> None:
    async with rig(PAIR) as made:
        await made.tick(2)
        key = KEYS.robot(21, Topic.COMMAND)
        for _ in range(3):
            made.hub.publish(key, json.dumps(SAMPLES[wire.Command]).encode())
        await made.tick(3)
        assert [n.code for n in made.notices if n.code == "done"] == ["done"]


# ---------------------------------------------------------------------- bad company


async def test_a_second_agent_for_a_robot_is_refused_loudly() -> None:
    twin = SimulationSettings(agent=AgentSettings(duplicate_wait_s=0.0))
    alone = world_setup((robot(26, 0.0),))
    async with rig(PAIR) as made, LocalBus(made.hub) as bus:
        second = Simulation(
            alone, twin, bus, KEYS, lambda robot_id: OnboardPilot(robot_id, Recorder()), "s2"
        )
        with pytest.raises(DuplicateRobotError, match="robot 26 of team red is flown by another"):
            async with second:
                pass
        await made.tick(2)
        assert made.links() == [(21, "connected"), (26, "connected")], "the first goes on"


async def test_a_stranger_under_its_own_id_makes_it_hold_and_tell() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (1.0, 0.0)}
        await made.tick(3)
        impostor = wire.decode(wire.State, json.dumps(SAMPLES[wire.State]).encode())
        made.hub.publish(KEYS.robot(21, Topic.STATE), wire.encode(impostor))
        await made.tick(3)
        assert made.velocity(21) == (0.0, 0.0)
        assert [n.text for n in made.notices if n.code == "duplicate"] == [
            "another agent flies robot 21: holding",
        ]
        await made.tick(25)
        assert made.velocity(21) == (1.0, 0.0), "the stranger has gone"


async def test_a_landing_goes_on_though_a_stranger_speaks_under_its_id() -> None:
    async with rig(PAIR) as made:
        await made.tick(2)
        made.order(21, wire.Order.LAND)
        await made.tick(3)
        impostor = wire.decode(wire.State, json.dumps(SAMPLES[wire.State]).encode())
        made.hub.publish(KEYS.robot(21, Topic.STATE), wire.encode(impostor))
        await made.tick(250)
        assert made.simulation.world.robot_state(21).altitude_m < 0.05
        assert "landed" in [n.text for n in made.notices if n.code == "done"]


async def test_a_second_planner_is_refused_while_the_first_is_alive() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (1.0, 0.0)}
        await made.tick(3)
        rival = wire.decode(wire.Setpoint, json.dumps(SAMPLES[wire.Setpoint]).encode())
        for _ in range(3):
            made.hub.publish(KEYS.robot(21, Topic.SETPOINT), wire.encode(rival))
            await made.tick()
            assert made.velocity(21) == (1.0, 0.0)


@pytest.mark.parametrize(
    "topic", [Topic.SETPOINT, Topic.KNOWLEDGE, Topic.COMMAND, Topic.STATE, Topic.HEARTBEAT]
)
async def test_malformed_messages_are_counted_and_change_nothing(topic: Topic) -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (1.0, 0.0)}
        await made.tick(3)
        key = KEYS.heartbeat if topic is Topic.HEARTBEAT else KEYS.robot(21, topic)
        junk = (b"", b"{}", b"\xff", b'{"v":2}', b"[" * 5000)
        for payload in junk:
            # It takes the place of a setpoint that waits; the next one counts again.
            made.hub.publish(key, payload)
            await made.tick(2)
            assert made.velocity(21) == (1.0, 0.0)
        await made.tick(11)
        health = made.link.health(21)
        assert health is not None
        assert health.refused >= 1
        assert health.dropped == 0


async def test_a_flood_keeps_memory_bounded_and_the_robot_flying(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (0.2, 0.0)}
        await made.tick(3)
        for _ in range(20_000):
            made.hub.publish(KEYS.robot(21, Topic.COMMAND), b"junk")
        await made.tick(12)
        assert made.velocity(21) == (0.2, 0.0)
        health = made.link.health(21)
        assert health is not None
        assert health.dropped == 18_000
        assert health.refused == 2_000
        assert caplog.text.count("refuses a message") <= 2 * MOST  # not a line for each


# ---------------------------------------------------------------------- health


async def test_a_planner_that_flies_others_only_is_told_of() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (1.0, 0.0)}
        await made.tick(25)
        health = made.link.health(26)
        assert health is not None
        assert health.reason == "the planner sends it nothing: is it of this team?"


async def test_who_gave_an_order_hears_of_it_though_no_planner_is_there() -> None:
    async with rig(PAIR) as made:
        await made.tick(3)
        await made.tick(10, planner="dead")
        order_id = made.order(21, wire.Order.HOLD)
        await made.tick(2, planner="dead")
        made.link.drain(made.time_s)
        assert [n.text for n in made.link.take_notices()] == ["holding"]
        await made.tick(3)
        assert [n.code for n in made.notices].count("done") == 0, "told once"
        assert order_id


async def test_health_is_told_once_a_second() -> None:
    async with rig(PAIR) as made:
        made.velocities = {21: (0.2, 0.0)}
        await made.tick(31)
        health = made.link.health(21)
        assert health is not None
        assert (health.mode, health.reason) == (wire.Mode.FLYING, "following setpoints")
        assert health.uptime_s == pytest.approx(3.0)
        assert health.seq == 3
        assert health.setpoints == pytest.approx(29, abs=1)
        assert health.heartbeat_age_s == pytest.approx(0.0, abs=TICK_S)
        assert made.link.health(99) is None
