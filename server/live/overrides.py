"""What people steer in person: assignment, weights, capacities, pins, severities, zones, approvals.

An override is a proposal like any other, judged by the same verification; it passes the gate,
which only tells its price. A zone drawn is a fact, and enters the mission as one: whoever drew
it is answered when it is known, so that the next request can name it. Everything asked for is on
the mission's tape.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

import structlog

from llm.verification import pins_with, with_frozen_rows
from server.encoding import EventKind, Severity
from server.gate.decisions import Decision, Status
from server.gate.encoding import decision_object
from server.gate.keeper import DecisionUnknown, NotPending
from server.live.channel import Json, RequestRefused
from server.live.council import LiveCouncil
from server.live.herald import Herald
from server.mission.changes import assignment_proposal
from server.mission.core import MissionCore
from server.mission.knowledge import MAX_ZONES
from solver.assignment import repair
from solver.directives import Directives, Pairing, Pin, Proposal, Source
from solver.observations import Observation, ZoneDrawn, ZoneErased
from solver.snapshot import Snapshot
from solver.zones import Zone, ZoneKind

log = structlog.get_logger(__name__)

MAX_PINS: Final = 256
"""Hard pins at once."""

KNOWN_S: Final = 1.0
"""Longest one waits for a zone to be known; while mission time stands still it will not be."""


class Overrides:
    """Does what people ask of one mission. All methods on the mission's event loop."""

    def __init__(
        self,
        core: MissionCore,
        council: LiveCouncil,
        herald: Herald,
        observe: Callable[[Observation], None],
    ) -> None:
        self._core = core
        self._council = council
        self._herald = herald
        self._observe = observe
        self._count = 0
        self._zones = 0

    async def do(self, what: str, asked: Json, author: str) -> Json:
        """Do one thing and return what came of it.

        Raises RequestRefused: override_refused (with the violations), pin_unknown,
        zone_unknown, too_many_pins, too_many_zones, decision_unknown, not_pending, wrong_state.
        """
        try:
            return await self._done(what, asked, author)
        except RequestRefused:
            raise
        except Exception as error:  # a fault in one request must not end the flight
            log.exception("an override failed", what=what)
            raise RequestRefused("internal_error", "the mission failed on this request") from error

    async def _done(self, what: str, asked: Json, author: str) -> Json:
        match what:
            case "zone":
                return await self._draw(asked, author)
            case "zone_change":
                return await self._change_zone(asked, author)
            case "zone_erase":
                return await self._erase(asked, author)
            case "approval":
                return await self._approve(asked, author)
        return await self._override(self._proposal(what, asked, author), what)

    # ------------------------------------------------------------------ proposals

    def _proposal(self, what: str, asked: Json, author: str) -> Proposal:
        snapshot = self._core.current
        self._count += 1
        empty = Proposal(
            id=f"p{self._count}", source=Source.OPERATOR, asked_s=snapshot.time_s, author=author
        )
        match what:
            case "assignment":
                rows = tuple((int(r), tuple(ts)) for r, ts in asked["assignment"].items())
                return replace(empty, assignment=with_frozen_rows(rows, snapshot))
            case "weights":
                return replace(empty, weights=tuple(float(w) for w in asked["weights"]))
            case "capacities":
                return _with_capacities(empty, snapshot, asked["capacities"])
            case "pin":
                return self._pinned(empty, snapshot, asked)
            case "unpin":
                if all(pin.id != asked["id"] for pin in snapshot.directives.pins):
                    raise RequestRefused("pin_unknown", f"There is no pin {asked['id']}.")
                return replace(empty, pins_lifted=(asked["id"],))
            case "severity":
                self._zone(asked["id"])
                return replace(empty, severities=((asked["id"], float(asked["severity"])),))
        raise RequestRefused("unknown_request", f"there is no override {what[:40]}")

    def _pinned(self, empty: Proposal, snapshot: Snapshot, asked: Json) -> Proposal:
        """Pin a pair, with the least change of the assignment that does what the pin wants."""
        hard = {pin.id for pin in snapshot.directives.pins if pin.comment_id is None}
        if asked["id"] not in hard and len(hard) >= MAX_PINS:
            raise RequestRefused("too_many_pins", f"{MAX_PINS} pins stand already; lift one first.")
        ttl_s = asked.get("ttl_s")
        pin = Pin(
            id=asked["id"],
            pair=Pairing(asked["robot"], asked["target"]),
            expires_s=None if ttl_s is None else snapshot.time_s + ttl_s,
            forbids=asked["forbids"],
        )
        same = next((p for p in snapshot.directives.pins if p.id == pin.id), None)
        if same is not None and replace(same, expires_s=None) == replace(pin, expires_s=None):
            # The same again changes nothing but the time it has left.
            pin = replace(same, expires_s=pin.expires_s)
        proposal = replace(empty, pins_set=(pin,))
        pins = pins_with(snapshot.directives.pins, proposal)
        return _mended(proposal, snapshot, replace(snapshot.directives, pins=pins))

    async def _override(self, proposal: Proposal, field: str) -> Json:
        card = await self._council.propose(proposal)
        return _told(card, field)

    # ------------------------------------------------------------------ zones

    async def _draw(self, asked: Json, author: str) -> Json:
        known = {zone.id for zone in self._core.snapshot.zones}
        if len(known) >= MAX_ZONES:
            raise RequestRefused("too_many_zones", f"{MAX_ZONES} zones are known already.")
        self._zones += 1
        while f"h{self._zones}" in known:
            self._zones += 1
        kind = ZoneKind(asked["kind"])
        defaults = self._core.setup.zone_defaults(kind)
        zone = Zone(
            id=f"h{self._zones}",
            kind=kind,
            mean=_point(asked["mean"]),
            covariance=(_point(asked["covariance"][0]), _point(asked["covariance"][1])),
            margin=defaults.margin if asked.get("margin") is None else asked["margin"],
            risk=defaults.risk if asked.get("risk") is None else asked["risk"],
            risk_single=defaults.risk_single,
        )
        self._say("drew", zone, author)
        await self._enter(ZoneDrawn(zone, author), lambda known: zone in known)
        return {"zone": _zone_object(zone), "decision": None}

    async def _change_zone(self, asked: Json, author: str) -> Json:
        """Change a zone as it is believed to be, its severity by way of verification."""
        zone = self._zone(asked["id"])
        told = None
        if asked.get("severity") is not None:
            proposal = self._proposal("severity", asked, author)
            told = (await self._override(proposal, "severity"))["decision"]
        covariance = asked.get("covariance")
        changed = replace(
            zone,
            mean=zone.mean if asked.get("mean") is None else _point(asked["mean"]),
            covariance=zone.covariance
            if covariance is None
            else (_point(covariance[0]), _point(covariance[1])),
            margin=zone.margin if asked.get("margin") is None else asked["margin"],
            risk=zone.risk if asked.get("risk") is None else asked["risk"],
        )
        if changed != zone:
            self._say("changed", zone, author)
            await self._enter(ZoneDrawn(changed, author), lambda known: changed in known)
        return {"zone": _zone_object(changed), "decision": told}

    async def _erase(self, asked: Json, author: str) -> Json:
        zone = self._zone(asked["id"])
        self._say("erased", zone, author)
        await self._enter(
            ZoneErased(zone.id, author), lambda known: all(one.id != zone.id for one in known)
        )
        return {"zone": _zone_object(zone), "decision": None}

    async def _enter(self, fact: Observation, known: Callable[[tuple[Zone, ...]], bool]) -> None:
        """Give the mission a fact; return when its zones are so, or it takes too long.

        Raises RequestRefused when the mission ends before it has taken the fact.
        """
        self._observe(fact)
        with suppress(TimeoutError):
            async with asyncio.timeout(KNOWN_S):
                while not known(self._core.snapshot.zones):
                    await self._council.tick_over()

    def _say(self, did: str, zone: Zone, author: str) -> None:
        words = f"{author.capitalize()} {did} zone {zone.id} ({zone.kind})."
        data = {
            "what": "zone",
            "source": Source.OPERATOR.value,
            "zone": zone.id,
            "did": did,
            "author": author,
        }
        self._herald.say(EventKind.DIRECTIVES, Severity.INFO, words, data)

    def _zone(self, zone_id: str) -> Zone:
        for zone in self._core.snapshot.zones:
            if zone.id == zone_id:
                return zone
        raise RequestRefused("zone_unknown", f"The team knows no zone {zone_id}.")

    # ------------------------------------------------------------------ approvals

    async def _approve(self, asked: Json, author: str) -> Json:
        try:
            card = await self._council.approve(asked["id"], approve=asked["approve"], by=author)
        except DecisionUnknown:
            words = f"There is no decision {asked['id']}."
            raise RequestRefused("decision_unknown", words) from None
        except NotPending as settled:
            details = {"decision": decision_object(settled.card)}
            words = f"Decision {settled.card.id} is {settled.card.status} already."
            raise RequestRefused("not_pending", words, details) from None
        return {"decision": decision_object(card)}


def _with_capacities(empty: Proposal, snapshot: Snapshot, asked: dict[str, int]) -> Proposal:
    """Change capacities, with the least change of the assignment that fits them."""
    wanted = {int(robot_id): capacity for robot_id, capacity in asked.items()}
    proposal = replace(empty, capacities=tuple(wanted.items()))
    current = snapshot.directives.capacities
    fitting = tuple((robot_id, wanted.get(robot_id, capacity)) for robot_id, capacity in current)
    return _mended(proposal, snapshot, replace(snapshot.directives, capacities=fitting))


def _mended(proposal: Proposal, snapshot: Snapshot, directives: Directives) -> Proposal:
    """Add the least change of the assignment that new directives need, if they need one."""
    pairs = repair(replace(snapshot, directives=directives))
    if pairs == snapshot.directives.assignment:
        return proposal
    rows = assignment_proposal(proposal.id, Source.OPERATOR, snapshot, pairs).assignment
    return replace(proposal, assignment=rows)


def _told(card: Decision, field: str) -> Json:
    if card.status is Status.REFUSED:
        raise RequestRefused(
            "override_refused",
            " ".join(card.reasons),
            {
                "field": field,
                "violations": list(card.reasons),
                "decision": decision_object(card),
            },
        )
    return {"decision": decision_object(card)}


def _zone_object(zone: Zone) -> Json:
    return {
        "id": zone.id,
        "kind": zone.kind.value,
        "mean": list(zone.mean),
        "covariance": [list(row) for row in zone.covariance],
        "margin": zone.margin,
        "risk": zone.risk,
    }


def _point(values: Any) -> tuple[float, float]:
    x, y = values
    return float(x), float(y)
