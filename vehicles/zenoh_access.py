"""Who may say and hear what on a team's bus, as Zenoh's access control states it.

Parties are known by the name they log in with, or by the common name of their certificate:
`robot21` for robot 21, `planner`, `operator` for orders from the command line, `world` for a
simulator of the whole team, and `site` for the router of another site. What no rule allows is
denied, so a vehicle publishes under its own id only, and only what vehicles say
(docs/messages.md): it can neither speak for another robot nor give itself a setpoint.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from vehicles.keys import DOWNWARD, UPWARD, TeamKeys, Topic

_OF_THE_WORLD = (Topic.SENSES, Topic.INCIDENTS)
_ABOUT_THE_WORLD = (Topic.POSE, *_OF_THE_WORLD)

PLANNER = "planner"
OPERATOR = "operator"
WORLD = "world"
SITE = "site"

JsonObject = dict[str, Any]


class Proof(StrEnum):
    """How a party shows who it is."""

    USER = "usernames"
    """By user and password."""

    CERTIFICATE = "cert_common_names"
    """By its own certificate."""


@dataclass(frozen=True, slots=True)
class AccessRules:
    """The team whose bus it is.

    Raises:
        ValueError: The team's name could not stand in a key.
    """

    team: str
    robot_ids: tuple[int, ...]

    def __post_init__(self) -> None:
        TeamKeys(self.team)


@dataclass(frozen=True, slots=True)
class _Party:
    """What one party may do."""

    name: str
    says: tuple[str, ...]
    hears: tuple[str, ...]
    holds: tuple[str, ...] = ()
    """Liveliness tokens."""

    watches: tuple[str, ...] = ()
    """Tokens of others."""


def robot_name(robot_id: int) -> str:
    """Return the name a robot logs in with."""
    return f"robot{robot_id}"


def access_control(rules: AccessRules, proofs: Iterable[Proof]) -> JsonObject:
    """Return the value of Zenoh's `access_control` for the party that listens.

    Args:
        rules: The team.
        proofs: How parties show who they are; all of them are asked for.

    Raises:
        ValueError: There is no proof, so nobody can be told from anybody else.
    """
    asked = tuple(proofs)
    if not asked:
        raise ValueError("access rules need users or certificates to tell parties apart")
    parties = _parties(rules)
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for party in parties for rule in _rules(party)],
        "subjects": [
            {"id": party.name} | {proof.value: [party.name] for proof in asked} for party in parties
        ],
        "policies": [
            {"rules": [rule["id"] for rule in _rules(party)], "subjects": [party.name]}
            for party in parties
        ],
    }


def _parties(rules: AccessRules) -> tuple[_Party, ...]:
    keys = TeamKeys(rules.team)
    robots = tuple(_robot(keys, robot_id) for robot_id in rules.robot_ids)
    planner = _Party(
        PLANNER,
        says=(*(keys.robot(None, topic) for topic in DOWNWARD), keys.heartbeat, keys.control),
        hears=(*(keys.robot(None, topic) for topic in UPWARD), keys.truth),
        watches=(keys.alive(None),),
    )
    operator = _Party(
        OPERATOR,
        says=(keys.robot(None, Topic.COMMAND),),
        hears=(keys.robot(None, Topic.EVENTS),),
        watches=(keys.alive(None),),
    )
    # Of the robots it simulates it says all, of the others what their world is like.
    world = _Party(
        WORLD,
        says=(
            *(keys.robot(robot_id, topic) for robot_id in rules.robot_ids for topic in UPWARD),
            *(keys.external(None, topic) for topic in _OF_THE_WORLD),
            keys.truth,
        ),
        hears=(
            *(key for robot_id in rules.robot_ids for key in _heard_by(keys, robot_id)),
            keys.external(None, Topic.POSE),
            keys.heartbeat,
            keys.control,
        ),
        holds=tuple(key for robot in robots for key in robot.holds),
        watches=tuple(key for robot in robots for key in robot.watches),
    )
    return (*robots, planner, operator, world, _site(keys))


def _site(keys: TeamKeys) -> _Party:
    """Return the router of another site, which speaks for all vehicles and worlds behind it.

    Between routers what somebody wants to hear is passed on as it was said, for the whole team
    at once, so the keys are the team's and not those of single robots.
    """
    return _Party(
        SITE,
        says=(
            *(keys.robot(None, topic) for topic in UPWARD),
            *(keys.external(None, topic) for topic in _ABOUT_THE_WORLD),
            keys.truth,
        ),
        hears=(
            *(keys.robot(None, topic) for topic in (*DOWNWARD, Topic.STATE)),
            *(keys.external(None, topic) for topic in _ABOUT_THE_WORLD),
            keys.heartbeat,
            keys.control,
        ),
        holds=(keys.alive(None),),
        watches=(keys.alive(None),),
    )


def _robot(keys: TeamKeys, robot_id: int) -> _Party:
    alive = keys.alive(robot_id)
    return _Party(
        robot_name(robot_id),
        says=(
            *(keys.robot(robot_id, topic) for topic in UPWARD),
            keys.external(robot_id, Topic.POSE),
        ),
        hears=(
            *_heard_by(keys, robot_id),
            *(keys.external(robot_id, topic) for topic in _OF_THE_WORLD),
            keys.heartbeat,
        ),
        holds=(alive,),
        watches=(alive,),
    )


def _heard_by(keys: TeamKeys, robot_id: int) -> tuple[str, ...]:
    """Return a robot's own keys that it hears; its state, to notice another under its id."""
    return tuple(keys.robot(robot_id, topic) for topic in (*DOWNWARD, Topic.STATE))


def _rules(party: _Party) -> list[JsonObject]:
    """Return a party's rules; ingress is what it sends, egress what it is sent."""
    wanted = (
        ("says", ("put",), ("ingress",), party.says),
        ("hears", ("declare_subscriber",), ("ingress",), party.hears),
        ("is-told", ("put",), ("egress",), party.hears),
        # The party that listens says what it wants to hear, so that it is sent at all.
        ("is-asked", ("declare_subscriber",), ("egress",), party.says),
        ("lives", ("liveliness_token",), ("ingress",), party.holds),
        (
            "looks",
            ("liveliness_query", "declare_liveliness_subscriber"),
            ("ingress",),
            party.watches,
        ),
        ("sees", ("liveliness_token", "reply"), ("egress",), party.watches),
    )
    return [
        {
            "id": f"{party.name}-{verb}",
            "permission": "allow",
            "messages": list(messages),
            "flows": list(flows),
            "key_exprs": list(keys),
        }
        for verb, messages, flows, keys in wanted
        if keys
    ]
