"""Access rules: what they say, and what real sessions can and cannot do under them."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from time import monotonic

import pytest

from solver.observations import Link
from tests.patience import PATIENCE_S
from tests.vehicles.buses import KEYS, LOOPBACK, Reader, reaches, until
from tests.vehicles.test_sim_worker import Mission, begin, job, worker
from vehicles import messages as wire
from vehicles.bus import Bus
from vehicles.keys import DOWNWARD, UPWARD, Topic
from vehicles.orders import send
from vehicles.sim_job import dump_job
from vehicles.zenoh_access import (
    OPERATOR,
    PLANNER,
    SITE,
    WORLD,
    AccessRules,
    Proof,
    access_control,
    robot_name,
)
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

RULES = AccessRules("red", (21, 26))
USERS = {
    "robot21": "falcon",
    "robot26": "kestrel",
    PLANNER: "mission",
    OPERATOR: "hand",
    WORLD: "globe",
    SITE: "meadow",
}


def keys_of(name: str, message: str, flow: str) -> set[str]:
    """Return the keys a party may use for a message in a direction."""
    rules = access_control(RULES, [Proof.USER])["rules"]
    return {
        key
        for rule in rules
        if rule["id"].startswith(f"{name}-")
        and message in rule["messages"]
        and flow in rule["flows"]
        for key in rule["key_exprs"]
    }


def test_a_robot_may_say_what_robots_say_under_its_own_id_only() -> None:
    said = {KEYS.robot(21, topic) for topic in UPWARD} | {KEYS.external(21, Topic.POSE)}
    assert keys_of("robot21", "put", "ingress") == said
    assert keys_of("robot21", "liveliness_token", "ingress") == {KEYS.alive(21)}
    own = {KEYS.robot(21, topic) for topic in (*DOWNWARD, Topic.STATE)} | {KEYS.heartbeat}
    own |= {KEYS.external(21, topic) for topic in (Topic.SENSES, Topic.INCIDENTS)}
    assert keys_of("robot21", "put", "egress") == own
    assert keys_of("robot21", "declare_subscriber", "ingress") == own


def test_another_sites_router_carries_all_that_robots_say_and_nothing_of_the_planners() -> None:
    said = keys_of(SITE, "put", "ingress")
    assert {KEYS.robot(None, topic) for topic in UPWARD} < said
    assert said.isdisjoint({KEYS.robot(None, topic) for topic in DOWNWARD} | {KEYS.heartbeat})
    assert keys_of(SITE, "declare_subscriber", "egress") == said, "asked for as the planner asks"
    heard = keys_of(SITE, "put", "egress")
    assert {KEYS.robot(None, topic) for topic in DOWNWARD} | {KEYS.heartbeat} < heard


def test_what_is_not_allowed_is_denied_and_everybody_is_asked_for_every_proof() -> None:
    control = access_control(RULES, [Proof.USER, Proof.CERTIFICATE])
    assert control["default_permission"] == "deny"
    assert {"id": "robot26", "usernames": ["robot26"], "cert_common_names": ["robot26"]} in control[
        "subjects"
    ]
    assert {subject["id"] for subject in control["subjects"]} == set(USERS)
    known = {rule["id"] for rule in control["rules"]}
    assert {rule for policy in control["policies"] for rule in policy["rules"]} == known


def test_rules_that_cannot_hold_are_refused() -> None:
    with pytest.raises(ValueError, match="to tell parties apart"):
        access_control(RULES, [])
    with pytest.raises(ValueError, match="to tell parties apart"):
        ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,), access=RULES)
    with pytest.raises(ValueError, match="team name"):
        AccessRules("red/blue", ())
    with pytest.raises(ValueError, match="mutual TLS needs"):
        ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,), tls_mutual=True)
    assert robot_name(21) == "robot21"


@pytest.fixture
def router(tmp_path: Path) -> ZenohSettings:
    users = tmp_path / "users.txt"
    users.write_text("".join(f"{name}:{word}\n" for name, word in USERS.items()))
    return ZenohSettings(
        mode=ZenohMode.ROUTER, listen=(LOOPBACK,), dictionary_file=str(users), access=RULES
    )


@asynccontextmanager
async def joined(at: ZenohBus, name: str) -> AsyncIterator[Bus]:
    settings = ZenohSettings(connect=at.endpoints, user=name, password=USERS[name])
    async with ZenohBus(settings, KEYS.delivery) as bus:
        yield bus


@pytest.mark.asyncio
async def test_a_vehicle_speaks_and_hears_for_itself_only(router: ZenohSettings) -> None:
    heard, tokens, orders = Reader(), Reader(), Reader()
    async with (
        ZenohBus(router, KEYS.delivery) as mission,
        joined(mission, "robot21") as vehicle,
        joined(mission, "robot26") as mate,
    ):
        await mission.subscribe("falconer/red/**", heard.inbox)
        await mission.watch(KEYS.alive(None), tokens.inbox)
        for topic in DOWNWARD:
            await mate.subscribe(KEYS.robot(26, topic), orders.inbox)
        await mate.subscribe(KEYS.robot(21, Topic.STATE), orders.inbox)
        await reaches(mission, orders, KEYS.robot(26, Topic.SETPOINT))
        await vehicle.announce(KEYS.alive(26))
        await vehicle.announce(KEYS.alive(21))
        await until(lambda: tokens.take())
        for topic in (*UPWARD, *DOWNWARD):
            vehicle.publish(KEYS.robot(26, topic), b"forged")
        for key in (*(KEYS.robot(21, topic) for topic in DOWNWARD), KEYS.heartbeat, KEYS.truth):
            vehicle.publish(key, b"forged")
        await reaches(vehicle, heard, KEYS.robot(21, Topic.STATE))
        await reaches(vehicle, heard, KEYS.robot(21, Topic.EVENTS))
        await reaches(mission, orders, KEYS.robot(26, Topic.COMMAND))
        assert not [sample for sample in heard.take() if sample.payload == b"forged"]
        assert not [sample for sample in orders.take() if sample.payload == b"forged"]
        assert KEYS.robot(21, Topic.STATE) not in {sample.key for sample in orders.take()}
        assert {sample.key for sample in tokens.take()} == {KEYS.alive(21)}
        assert await vehicle.present(KEYS.alive(21)) == (KEYS.alive(21),)


@pytest.mark.asyncio
async def test_a_planner_and_a_world_on_a_router_reach_each_other(router: ZenohSettings) -> None:
    states, setpoints, tokens = Reader(), Reader(), Reader()
    async with (
        ZenohBus(router, KEYS.delivery) as between,
        joined(between, PLANNER) as planner,
        joined(between, WORLD) as world,
    ):
        await planner.subscribe(KEYS.robot(None, Topic.STATE), states.inbox)
        await planner.watch(KEYS.alive(None), tokens.inbox)
        await world.subscribe(KEYS.robot(26, Topic.SETPOINT), setpoints.inbox)
        await world.announce(KEYS.alive(26))
        await reaches(world, states, KEYS.robot(26, Topic.STATE))
        await reaches(planner, setpoints, KEYS.robot(26, Topic.SETPOINT))
        await until(lambda: tokens.take())
        assert await world.present(KEYS.alive(26)) == (KEYS.alive(26),)
        routed = Reader()
        await between.subscribe(KEYS.robot(None, Topic.STATE), routed.inbox)
        planner.publish(KEYS.robot(21, Topic.STATE), b"forged")
        await reaches(world, routed, KEYS.robot(21, Topic.STATE))
        assert not [sample for sample in routed.take() if sample.payload == b"forged"]


@pytest.mark.asyncio
async def test_an_operator_orders_and_hears_the_answer_and_no_more(router: ZenohSettings) -> None:
    orders, events, routed = Reader(), Reader(), Reader()
    async with (
        ZenohBus(router, KEYS.delivery) as mission,
        joined(mission, OPERATOR) as operator,
        joined(mission, "robot21") as vehicle,
    ):
        await vehicle.announce(KEYS.alive(21))
        await vehicle.subscribe(KEYS.robot(21, Topic.COMMAND), orders.inbox)
        await operator.subscribe(KEYS.robot(21, Topic.EVENTS), events.inbox)
        await mission.subscribe(KEYS.robot(21, Topic.SETPOINT), routed.inbox)
        operator.publish(KEYS.robot(21, Topic.SETPOINT), b"forged")
        await reaches(operator, orders, KEYS.robot(21, Topic.COMMAND))
        await reaches(vehicle, events, KEYS.robot(21, Topic.EVENTS))
        assert await operator.present(KEYS.alive(21)) == (KEYS.alive(21),)
        assert routed.take() == []


@pytest.mark.asyncio
async def test_a_robot_that_is_flown_elsewhere_has_its_link_with_the_world(
    router: ZenohSettings,
) -> None:
    poses, senses = Reader(), Reader()
    async with (
        ZenohBus(router, KEYS.delivery) as between,
        joined(between, WORLD) as world,
        joined(between, "robot21") as vehicle,
    ):
        await world.subscribe(KEYS.external(21, Topic.POSE), poses.inbox)
        await vehicle.subscribe(KEYS.external(21, Topic.SENSES), senses.inbox)
        vehicle.publish(KEYS.external(26, Topic.POSE), b"forged")
        await reaches(vehicle, poses, KEYS.external(21, Topic.POSE))
        await reaches(world, senses, KEYS.external(21, Topic.SENSES))
        assert {sample.key for sample in poses.take()} == {KEYS.external(21, Topic.POSE)}


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_simulated_team_flies_under_the_rules(router: ZenohSettings) -> None:
    """A planner and a simulation, each a client with its own name: nothing they need is denied."""
    async with ZenohBus(router, KEYS.delivery) as between:
        client = ZenohSettings(connect=between.endpoints)
        planner = replace(client, user=PLANNER, password=USERS[PLANNER])
        world = replace(client, user=WORLD, password=USERS[WORLD])
        async with ZenohBus(planner, KEYS.delivery) as bus, worker() as simulation:
            await begin(simulation, dump_job(replace(job(between.endpoints), zenoh=world)))
            mission = Mission(bus, "p1")
            async with mission.link:
                await mission.until_speed(0.5)
                assert set(mission.links().values()) == {Link.CONNECTED}
                send(bus, KEYS, 21, wire.Order.HOLD, "test", monotonic())
                mission.link.control_world(wire.WorldAction.PAUSE)
                async with asyncio.timeout(PATIENCE_S):
                    while (truth := mission.link.truth()) is None or (
                        truth.state is not wire.WorldState.PAUSED
                    ):
                        await mission.tick()
