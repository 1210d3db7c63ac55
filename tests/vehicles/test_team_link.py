"""The planner's end of the bus, in virtual time."""

import json
from dataclasses import replace
from typing import Any

import pytest

from solver.observations import Attack, Link, LinkChange, RobotState, TrackReport
from solver.setpoints import Setpoint
from solver.zones import ZoneKind
from tests.vehicles.buses import KEYS, Reader
from tests.vehicles.pilots import knowledge, track
from tests.vehicles.samples import SAMPLES, TRACK, ZONE
from vehicles import messages as wire
from vehicles import translation
from vehicles.keys import Topic
from vehicles.link_monitor import LinkSettings
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.team_link import EVENTS_PER_TICK, TeamLink

pytestmark = pytest.mark.asyncio


class Desk:
    """A team link with a clock, and robots that say what they are told to say."""

    def __init__(self) -> None:
        self.hub = LocalHub()
        self.now_s = 50.0
        self.bus = LocalBus(self.hub)
        self.link = TeamLink(self.bus, KEYS, (21, 26), "p1", lambda: self.now_s, LinkSettings())
        self.seq = 10

    async def __aenter__(self) -> "Desk":
        await self.bus.__aenter__()
        await self.link.__aenter__()
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.link.__aexit__()
        await self.bus.__aexit__(None, None, None)

    def say(self, kind: type[wire.Message], robot_id: int = 21, **changes: Any) -> None:
        """Publish a sample message of a robot, changed."""
        topic = {
            wire.State: Topic.STATE,
            wire.Detections: Topic.DETECTIONS,
            wire.Health: Topic.HEALTH,
            wire.Event: Topic.EVENTS,
        }[kind]
        self.seq += 1
        fields = {**SAMPLES[kind], "robot_id": robot_id, "seq": self.seq, **changes}
        self.hub.publish(KEYS.robot(robot_id, topic), json.dumps(fields).encode())


def kinds(found: tuple[object, ...]) -> list[str]:
    return [type(one).__name__ for one in found]


async def test_observations_come_in_the_order_promised() -> None:
    async with Desk() as desk:
        desk.say(wire.Detections)
        desk.say(wire.State)
        desk.say(wire.Event)
        found = desk.link.drain(0.0)
        assert kinds(found) == ["LinkChange", "Attack", "RobotState", "Detections"]
        assert desk.link.drain(0.1) == ()


async def test_the_newest_state_counts_and_an_older_one_never() -> None:
    async with Desk() as desk:
        desk.say(wire.State, position=[1.0, 1.0], seq=100)
        desk.say(wire.State, position=[2.0, 2.0], seq=101)
        states = [o for o in desk.link.drain(0.0) if isinstance(o, RobotState)]
        assert [state.position for state in states] == [(2.0, 2.0)]
        desk.say(wire.State, position=[1.5, 1.5], seq=100)
        assert desk.link.drain(0.1) == ()


async def test_attacks_are_dated_by_their_age_and_every_one_counts() -> None:
    async with Desk() as desk:
        for age in (7.5, 0.0):
            desk.say(wire.Event, age_s=age)
        attacks = [o for o in desk.link.drain(10.0) if isinstance(o, Attack)]
        assert [attack.time_s for attack in attacks] == [2.5, 10.0]
        assert attacks[0].kind is ZoneKind.SENSING
        assert attacks[0].zone is not None
        assert attacks[0].zone.id == "s1"


@pytest.mark.parametrize(("age", "tracks"), [(0.5, 1), (5.0, 0)])
async def test_a_return_is_reported_and_old_tracks_are_left_out(age: float, tracks: int) -> None:
    async with Desk() as desk:
        event = {"type": "return", "tracks": [TRACK], "zones": [ZONE]}
        desk.say(wire.Event, age_s=age, event=event)
        (report,) = [o for o in desk.link.drain(0.0) if isinstance(o, TrackReport)]
        assert len(report.tracks) == tracks
        assert [zone.id for zone in report.zones] == ["s1"]


async def test_what_is_for_people_becomes_notices() -> None:
    async with Desk() as desk:
        for event in (
            {"type": "recovery", "kind": "sensing"},
            {"type": "mode", "mode": "holding", "previous": "flying", "reason": "no planner"},
            {"type": "notice", "code": "battery", "text": "12 % left"},
        ):
            desk.say(wire.Event, event=event, age_s=1.0)
        assert kinds(desk.link.drain(3.0)) == ["LinkChange"]
        told = [(n.robot_id, n.code, n.text, n.time_s) for n in desk.link.take_notices()]
        assert told == [
            (21, "recovery", "sensing works again", 2.0),
            (21, "mode", "holding: no planner", 2.0),
            (21, "battery", "12 % left", 2.0),
        ]
        assert desk.link.take_notices() == ()


async def test_silences_are_told_by_tokens() -> None:
    async with Desk() as desk, LocalBus(desk.hub) as vehicles:
        token = await vehicles.announce(KEYS.alive(21))
        desk.say(wire.State)
        assert desk.link.drain(0.0)[0] == LinkChange(21, Link.CONNECTED, "heard")
        desk.now_s += 0.6
        assert [o.link for o in desk.link.drain(0.6) if isinstance(o, LinkChange)] == [Link.JAMMED]
        await token.close()
        assert [o.link for o in desk.link.drain(0.6) if isinstance(o, LinkChange)] == [Link.LOST]
        assert desk.link.link(21) is Link.LOST


async def test_a_planner_that_slept_takes_what_waits_before_it_judges() -> None:
    async with Desk() as desk:
        desk.say(wire.State)
        desk.link.drain(0.0)
        desk.now_s += 5.0
        desk.say(wire.State)
        changes = [o for o in desk.link.drain(5.0) if isinstance(o, LinkChange)]
        assert [change.robot_id for change in changes] == [26]


async def test_strangers_seconds_and_liars_are_refused_and_told_once() -> None:
    async with Desk() as desk:
        desk.say(wire.State)
        desk.link.drain(0.0)
        for _ in range(3):
            desk.say(wire.State, boot="other", position=[9.0, 9.0])
            desk.say(wire.State, robot_id=99)
            desk.hub.publish(KEYS.robot(26, Topic.STATE), json.dumps(SAMPLES[wire.State]).encode())
            assert not [o for o in desk.link.drain(0.1) if isinstance(o, RobotState)]
        assert desk.link.refused == 9
        told = {(n.robot_id, n.code): n.text for n in desk.link.take_notices()}
        assert told == {
            (21, "duplicate"): "robot 21: a second agent flies it; only the first is listened to",
            (99, "unknown"): "robot 99: not of this team",
            (26, "refused"): "says another id than its key",
        }


async def test_junk_is_counted_and_does_no_harm() -> None:
    async with Desk() as desk:
        for topic in (Topic.STATE, Topic.DETECTIONS, Topic.EVENTS, Topic.HEALTH):
            desk.hub.publish(KEYS.robot(21, topic), b"junk")
        desk.hub.publish(KEYS.truth, b"junk")
        assert desk.link.drain(0.0) == ()
        assert desk.link.refused == 4
        assert desk.link.truth() is None


async def test_a_message_that_cannot_be_said_is_counted_and_the_others_are_sent() -> None:
    async with Desk() as desk, LocalBus(desk.hub) as vehicles:
        reader = Reader()
        await vehicles.subscribe(KEYS.robot(None, Topic.SETPOINT), reader.inbox)
        await vehicles.subscribe(KEYS.robot(None, Topic.KNOWLEDGE), reader.inbox)
        good = Setpoint(26, (0.5, 0.0), (1.0, 0.0), 1.5, 0.5)
        desk.link.send_setpoints((replace(good, robot_id=21, velocity=(1e5, 0.0)), good), "m1")
        lost = replace(knowledge(21), tracks=(track(122, 1e13, 0.0),))
        desk.link.send_knowledge(lost, knowledge(26))
        keys = [sample.key for sample in reader.take()]
        assert sorted(keys) == sorted(KEYS.robot(26, t) for t in (Topic.SETPOINT, Topic.KNOWLEDGE))
        assert desk.link.unsaid == 2


async def test_strangers_are_not_even_read(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[bytes] = []

    def decode(kind: type[wire.Message], payload: bytes) -> wire.Message:
        read.append(payload)
        return wire_decode(kind, payload)

    wire_decode = wire.decode
    monkeypatch.setattr(wire, "decode", decode)
    async with Desk() as desk:
        for robot_id in range(100, 200):
            desk.say(wire.State, robot_id=robot_id)
        desk.say(wire.State)
        assert kinds(desk.link.drain(0.0)) == ["LinkChange", "RobotState"]
        assert desk.link.refused == 100
    assert len(read) == 1


async def test_a_robot_that_floods_delays_itself_only() -> None:
    """A thousand true events at once: some in each tick, all in order, others' at once."""
    async with Desk() as desk:
        for number in range(1000):
            attack = {"type": "notice", "code": "n", "text": str(number)}
            desk.say(wire.Event, event=attack)
        desk.say(wire.Event, robot_id=26, event={"type": "notice", "code": "n", "text": "heard"})
        desk.link.drain(0.0)
        first = [notice.text for notice in desk.link.take_notices()]
        assert first == [*map(str, range(EVENTS_PER_TICK)), "heard"]
        for _ in range(9):
            desk.link.drain(0.1)
        rest = [notice.text for notice in desk.link.take_notices()]
        assert rest == list(map(str, range(EVENTS_PER_TICK, 1000)))


async def test_a_flood_of_events_is_bounded_and_said() -> None:
    async with Desk() as desk:
        for _ in range(10_050):
            desk.hub.publish(KEYS.robot(21, Topic.EVENTS), b"junk")
        desk.link.drain(0.0)
        codes = [notice.code for notice in desk.link.take_notices()]
        assert codes == ["refused", "dropped"]


async def test_what_is_sent_arrives_as_it_is() -> None:
    async with Desk() as desk, LocalBus(desk.hub) as vehicles:
        reader = Reader()
        for topic in (Topic.SETPOINT, Topic.KNOWLEDGE):
            await vehicles.subscribe(KEYS.robot(21, topic), reader.inbox)
        await vehicles.subscribe(KEYS.heartbeat, reader.inbox)
        await vehicles.subscribe(KEYS.control, reader.inbox)
        setpoint = Setpoint(21, (0.1, 0.2), (1.0, 2.0), 1.5, 0.5)
        desk.link.send_setpoints((setpoint,), "m1")
        desk.link.send_knowledge(knowledge(21))
        desk.link.send_heartbeat("m1", 7, 0.7, wire.PlannerState.HELD)
        desk.link.control_world(wire.WorldAction.RESET, 5)
        found = {sample.key: sample.payload for sample in reader.take()}
        sent = wire.decode(wire.Setpoint, found[KEYS.robot(21, Topic.SETPOINT)])
        assert translation.setpoint_of(sent) == setpoint
        assert (sent.boot, sent.seq, sent.stamp_s, sent.mission) == ("p1", 0, 50.0, "m1")
        known = wire.decode(wire.Knowledge, found[KEYS.robot(21, Topic.KNOWLEDGE)])
        assert translation.knowledge_of(known, 10.0).zones == knowledge(21).zones
        beat = wire.decode(wire.Heartbeat, found[KEYS.heartbeat])
        assert (beat.tick, beat.time_s, beat.state) == (7, 0.7, wire.PlannerState.HELD)
        control = wire.decode(wire.WorldControl, found[KEYS.control])
        assert (control.action, control.seed) == (wire.WorldAction.RESET, 5)
