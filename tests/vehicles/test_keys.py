"""Keys are built and read alike; strangers are not ours."""

import pytest

from vehicles.keys import Address, Delivery, TeamKeys, Topic


def test_keys_are_those_of_the_design() -> None:
    keys = TeamKeys("red")
    assert keys.robot(21, Topic.STATE) == "falconer/red/robots/21/state"
    assert keys.robot(None, Topic.EVENTS) == "falconer/red/robots/*/events"
    assert keys.alive(21) == "falconer/red/alive/21"
    assert keys.alive(None) == "falconer/red/alive/*"
    assert keys.heartbeat == "falconer/red/planner/heartbeat"
    assert keys.truth == "falconer/red/world/truth"
    assert keys.control == "falconer/red/world/control"
    assert keys.external(21, Topic.POSE) == "falconer/red/world/robots/21/pose"
    assert keys.external(None, Topic.SENSES) == "falconer/red/world/robots/*/senses"


@pytest.mark.parametrize(
    ("key", "address", "delivery"),
    [
        ("falconer/red/robots/21/state", Address(Topic.STATE, 21), Delivery.LATEST),
        ("falconer/red/robots/21/events", Address(Topic.EVENTS, 21), Delivery.EVENT),
        ("falconer/red/robots/0/command", Address(Topic.COMMAND, 0), Delivery.EVENT),
        ("falconer/red/robots/0/setpoint", Address(Topic.SETPOINT, 0), Delivery.LATEST),
        ("falconer/red/alive/7", Address(Topic.ALIVE, 7), Delivery.EVENT),
        ("falconer/red/planner/heartbeat", Address(Topic.HEARTBEAT, None), Delivery.LATEST),
        ("falconer/red/world/truth", Address(Topic.TRUTH, None), Delivery.LATEST),
        ("falconer/red/world/control", Address(Topic.CONTROL, None), Delivery.EVENT),
        ("falconer/red/world/robots/21/pose", Address(Topic.POSE, 21), Delivery.LATEST),
        ("falconer/red/world/robots/21/senses", Address(Topic.SENSES, 21), Delivery.LATEST),
        ("falconer/red/world/robots/21/incidents", Address(Topic.INCIDENTS, 21), Delivery.EVENT),
    ],
)
def test_a_key_says_what_it_is_and_how_it_is_carried(
    key: str, address: Address, delivery: Delivery
) -> None:
    keys = TeamKeys("red")
    assert keys.parse(key) == address
    assert keys.delivery(key) is delivery


@pytest.mark.parametrize(
    "key",
    [
        "",
        "falconer/blue/robots/21/state",
        "falconer/red/robots/x/state",
        "falconer/red/robots/-1/state",
        "falconer/red/robots/12345678901/state",
        "falconer/red/robots/21/heartbeat",
        "falconer/red/robots/21/state/more",
        "falconer/red/robots/21/",
        "falconer/red/planner/state",
        "falconer/red/world/robots/21/state",
        "falconer/red/robots/21/pose",
        "falconer/redder/robots/21/state",
    ],
)
def test_strangers_are_not_ours(key: str) -> None:
    assert TeamKeys("red").parse(key) is None


@pytest.mark.parametrize("team", ["", "a/b", "*", "ä", "x" * 65, "a b", "red\n"])
def test_a_team_name_must_fit_into_a_key(team: str) -> None:
    with pytest.raises(ValueError, match="team name"):
        TeamKeys(team)
