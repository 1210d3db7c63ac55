"""Robots that others fly in a simulated world: it senses for them, strikes them and jams them."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest

from solver.observations import Attack, Detections, RobotState, TrackReport
from solver.streams import Streams
from solver.zones import Point, ZoneKind
from tests.vehicles.buses import KEYS
from tests.vehicles.rigs import TICK_S, Rig, rig
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles import messages as wire
from vehicles import world_messages
from vehicles.agent import VehicleAgent
from vehicles.body import BodyState
from vehicles.jamming import JammableBus
from vehicles.keys import Topic
from vehicles.local_bus import LocalBus
from vehicles.onboard import OnboardPilot
from vehicles.settings import AgentSettings
from vehicles.simulated import SimulatedBody
from vehicles.world.setup import WorldSetup, WorldTarget
from vehicles.world.world import World
from vehicles.world_link import WorldLink

pytestmark = pytest.mark.asyncio

SMALL = ((0.01, 0.0), (0.0, 0.01))


def setup(kind: ZoneKind = ZoneKind.SENSING) -> WorldSetup:
    """Robot 26 is flown elsewhere; a zone waits for it at (5, 5)."""
    return world_setup(
        (robot(21, 0.0), robot(26, 5.0)),
        (WorldTarget(122, (5.0, 3.0)), WorldTarget(124, (9.0, 0.0))),
        (zone("z", kind, (5.0, 5.0), SMALL, margin=0.0),),
    )


@dataclass
class Stranger:
    """A vehicle that the world does not simulate: it is where the test says it is."""

    agent: VehicleAgent
    link: WorldLink
    radio: JammableBus
    position: Point = (5.0, 0.0)

    async def step(self, now_s: float) -> None:
        self.link.tell(
            BodyState(self.position, (0.0, 0.25), 1.5, wire.Mode.HOLDING, "", True, None, 0.0),
            now_s,
        )
        self.link.listen(now_s)
        self.radio.jammed = self.link.failures().communication
        await self.agent.step(now_s)


@asynccontextmanager
async def stranger(made: Rig) -> AsyncIterator[Stranger]:
    """Fly robot 26 beside the rig's world. Its body is another world's, where nothing happens."""
    elsewhere = world_setup((robot(26, 5.0),))
    async with LocalBus(made.hub) as bus, WorldLink(26, bus, KEYS, "w26") as link:
        radio = JammableBus(bus)
        body = SimulatedBody(elsewhere.robots[0], World(elsewhere, Streams(0)))
        pilot = OnboardPilot(26, made.recorder)
        agent = VehicleAgent(radio, KEYS, body, link, pilot, "b26", AgentSettings())
        await agent.start()
        try:
            yield Stranger(agent, link, radio)
        finally:
            await agent.close()


async def live(made: Rig, one: Stranger, ticks: int) -> list[object]:
    """Let world, stranger and planner live; return what the planner observed of robot 26."""
    seen: list[object] = []
    for _ in range(ticks):
        await one.step(made.now_s + TICK_S)
        seen += await made.tick()
    return [what for what in seen if getattr(what, "robot_id", None) == 26]


async def test_the_world_senses_from_where_the_robot_says_it_is() -> None:
    async with rig(setup(), external=(26,)) as made, stranger(made) as one:
        made.tell(26, targets=(122,))
        await live(made, one, 3)
        one.position = (5.0, 2.5)
        seen = await live(made, one, 10)
        detections = [what for what in seen if isinstance(what, Detections)]
        assert len(detections) >= 9
        last = detections[-1]
        assert last.position == (5.0, 2.5)
        assert [s.target_id for s in last.sightings] == [122], "only what it is to track"
        assert last.sightings[0].range_m == pytest.approx(0.5, abs=1.5)
        truth = made.link.truth()
        assert truth is not None
        assert [(r.id, r.position) for r in truth.robots][1] == (26, (5.0, 2.5))
        assert truth.robots[1].velocity == (0.0, 0.25)
        assert made.simulation.world.path_length_m(26) == pytest.approx(2.5)


async def test_no_moment_is_seen_twice_and_none_while_the_world_is_paused() -> None:
    async with rig(setup(), external=(26,)) as made, stranger(made) as one:
        made.tell(26, targets=(122,))
        await live(made, one, 3)
        await one.step(made.now_s + 0.05)
        await one.step(made.now_s + 0.06)
        assert len([s for s in await made.tick() if isinstance(s, Detections)]) <= 1
        made.link.control_world(wire.WorldAction.PAUSE)
        await live(made, one, 3)
        seen = await live(made, one, 10)
        assert not [what for what in seen if isinstance(what, Detections)]
        assert len([what for what in seen if isinstance(what, RobotState)]) == 10


async def test_a_sensing_zone_blinds_it_once_it_is_there_and_it_says_so() -> None:
    async with rig(setup(), external=(26,)) as made, stranger(made) as one:
        made.tell(26, targets=(122,))
        await live(made, one, 5)
        one.position = (5.0, 5.0)
        seen = await live(made, one, 10)
        attacks = [what for what in seen if isinstance(what, Attack)]
        assert len(attacks) > 5
        assert attacks[0].zone is not None
        assert attacks[0].zone.id == "z"
        states = [what for what in seen if isinstance(what, RobotState)]
        assert states[-1].sensing_failed
        one.position = (5.0, 0.0)
        seen = await live(made, one, 5)
        attacks += [what for what in seen if isinstance(what, Attack)]
        assert len(attacks) == made.simulation.world.hits(ZoneKind.SENSING)
        assert [n.text for n in made.notices if n.code == "recovery"] == ["sensing works again"]
        assert isinstance(seen[-1], Detections)


async def test_a_communication_zone_silences_it_and_it_merges_when_it_is_out() -> None:
    there = setup(ZoneKind.COMMUNICATION)
    async with rig(there, external=(26,)) as made, stranger(made) as one:
        made.tell(26, targets=(122,))
        await live(made, one, 5)
        one.position = (5.0, 5.0)
        await live(made, one, 3)
        assert one.radio.jammed
        assert not [w for w in await live(made, one, 10) if isinstance(w, RobotState)]
        assert made.links()[-1] == (26, "jammed")
        one.position = (5.0, 0.0)
        seen = await live(made, one, 5)
        assert made.links()[-1] == (26, "connected")
        (report,) = [what for what in seen if isinstance(what, TrackReport)]
        assert "z" in [z.id for z in report.zones]
        assert [t.target_id for t in report.tracks] == [122]


async def test_a_world_that_dies_lets_its_robots_go() -> None:
    there = setup(ZoneKind.COMMUNICATION)
    async with rig(there, external=(26,)) as made, stranger(made) as one:
        one.position = (5.0, 5.0)
        await live(made, one, 3)
        assert one.radio.jammed
        for _ in range(9):
            made.now_s += TICK_S
            await one.step(made.now_s)
        assert one.radio.jammed
        for _ in range(3):
            made.now_s += TICK_S
            await one.step(made.now_s)
        assert not one.radio.jammed


async def test_who_says_nothing_takes_no_part() -> None:
    there = world_setup((robot(21, 9.0), robot(26, 5.0, 5.0)), (), setup().zones)
    async with rig(there, external=(26,)) as made:
        await made.tick(10)
        assert made.simulation.world.hits(ZoneKind.SENSING) == 0
        assert made.links() == [(21, "connected")], "nobody says it is there"
        async with stranger(made) as one:
            one.position = (5.0, 5.0)
            await live(made, one, 3)
        hits = made.simulation.world.hits(ZoneKind.SENSING)
        assert hits > 0
        await made.tick(9)
        hits = made.simulation.world.hits(ZoneKind.SENSING)
        await made.tick(20)
        assert made.simulation.world.hits(ZoneKind.SENSING) == hits


async def test_a_reset_world_knows_it_still() -> None:
    async with rig(setup(), external=(26,)) as made, stranger(made) as one:
        made.tell(26, targets=(122,))
        one.position = (5.0, 2.0)
        await live(made, one, 5)
        made.link.control_world(wire.WorldAction.RESET, 3)
        seen = await live(made, one, 5)
        assert made.position(26) == (5.0, 2.0)
        assert isinstance(seen[-1], Detections)


async def test_poses_that_are_none_or_not_its_business_are_refused() -> None:
    async with rig(setup(), external=(26,)) as made:
        header = {"v": 1, "boot": "x", "seq": 0, "stamp_s": 0.0}
        numbers = {"position": (1.0, 1.0), "velocity": (0.0, 0.0), "altitude_m": 1.0}
        own = world_messages.Pose(**header, robot_id=21, **numbers)  # type: ignore[arg-type]
        for key, payload in (
            (KEYS.external(26, Topic.POSE), b"{"),
            (KEYS.external(26, Topic.POSE), wire.encode(own)),
            (KEYS.external(21, Topic.POSE), wire.encode(own)),
        ):
            made.hub.publish(key, payload)
            await made.tick()
        assert made.position(21) == (0.0, 0.0)
        assert made.position(26) == (5.0, 0.0)
        async with stranger(made) as one:
            made.hub.publish(KEYS.external(26, Topic.SENSES), b'{"v":2}')
            made.hub.publish(KEYS.external(26, Topic.INCIDENTS), b"[]")
            await live(made, one, 2)
            assert one.link.refused == 2


async def test_an_external_robot_must_be_one_of_the_world() -> None:
    with pytest.raises(ValueError, match=r"external robot 27: the world's robots are 21, 26"):
        async with rig(setup(), external=(27,)):
            pass
