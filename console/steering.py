"""What one person does in person from the page, by the very way that REST goes.

Bodies are the models of `server.api.directing_models`, so that the same is refused; the mission
verifies, attributes and answers with a decision card. Whoever only looks does not come here: the
desk of each page sees to that, as the doorkeeper does for REST.
"""

import asyncio
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from http import HTTPStatus
from typing import Any, Final, TypeVar

from pydantic import ValidationError

from server.api.directing_models import (
    AssignmentRequest,
    CapacitiesRequest,
    PinRequest,
    WeightsRequest,
    ZoneChangeRequest,
    ZoneRequest,
)
from server.api.errors import ServiceError
from server.api.models import Body
from server.api.service import MissionService

Json = dict[str, Any]
_Body = TypeVar("_Body", bound=Body)

SHOWN_PROBLEMS: Final = 4
TAKEN_IN_S: Final = 5.0


class PairState(StrEnum):
    """What people have said of a robot and a target."""

    FREE = "free"
    PINNED = "pinned"
    FORBIDDEN = "forbidden"


@dataclass(slots=True)
class Steering:
    """One person's hand on the mission that the console shows.

    Each method returns what was done in words, or the zone it was done to. Raises ServiceError:
    what verification refuses in its words, and `invalid_request` naming each field and its range.
    """

    service: MissionService
    mission: str
    author: str

    async def turn(self, robot_id: int, target_id: int) -> str:
        """Turn a pair on: free, pinned, forbidden, free."""
        directives = self.picture()["directives"]
        pins = [p for p in directives["pins"] if (p["robot"], p["target"]) == (robot_id, target_id)]
        pair = f"D{robot_id} and T{target_id}"
        match state_of(pins):
            case PairState.FREE:
                pin_id = free_pin_id(directives["pins"], robot_id, target_id)
                card = await self._pin(pin_id, robot_id, target_id, PairState.PINNED)
                return f"{pair} stay together until you say otherwise.{price(card)}"
            case PairState.PINNED:
                pin_id = binding(pins)["id"]
                card = await self._pin(pin_id, robot_id, target_id, PairState.FORBIDDEN)
                return f"{pair} are kept apart until you say otherwise.{price(card)}"
            case PairState.FORBIDDEN:
                for pin in pins:
                    await self._direct("unpin", {"id": pin["id"]})
                return f"{pair} are free again: the models may do as they see fit."

    async def weigh(self, weights: Mapping[str, float]) -> str:
        """Put all four weights in force."""
        body = checked(WeightsRequest, weights)
        card = await self._direct("weights", {"weights": body.ordered()})
        return f"The weights are in force.{price(card)}"

    async def allow(self, robot_id: int, most: int | None) -> str:
        """Set how many targets a robot may have."""
        body = checked(CapacitiesRequest, {"capacities": {str(robot_id): most}})
        card = await self._direct("capacities", body.model_dump())
        return f"D{robot_id} takes at most {most}.{price(card)}"

    async def assign(self, assignment: Mapping[str, list[int]]) -> str:
        """Replace the whole assignment."""
        body = checked(AssignmentRequest, {"assignment": assignment})
        card = await self._direct("assignment", body.model_dump())
        return f"The assignment is in force.{price(card)}"

    async def weigh_zone(self, zone_id: str, severity: float) -> str:
        """Set a zone's severity."""
        body = checked(ZoneChangeRequest, {"severity": severity})
        card = await self._direct("zone_change", body.model_dump() | {"id": zone_id})
        return f"Zone {zone_id} has severity {severity:g}.{price(card)}"

    async def draw(self, zone: Mapping[str, Any]) -> Json:
        """Draw a zone and return it as it is now."""
        answer = await self._ask("zone", checked(ZoneRequest, zone).model_dump())
        drawn: Json = answer["zone"]
        return drawn

    async def erase(self, zone_id: str) -> Json:
        """Erase a zone and return it as it was shown, for `restore`."""
        zones = self.picture()["zones"]
        shown: Json | None = next((zone for zone in zones if zone["id"] == zone_id), None)
        if shown is None:
            raise refusal(f"The team knows no zone {zone_id}.")
        await self._ask("zone_erase", {"id": zone_id})
        return shown

    async def restore(self, zone: Json) -> Json:
        """Draw an erased zone again, with its severity; it gets a new id."""
        drawn = await self.draw(
            {key: zone[key] for key in ("kind", "mean", "covariance", "margin", "risk")}
        )
        if zone["severity"] != 1.0:
            await self._until_known(drawn["id"])
            await self.weigh_zone(drawn["id"], zone["severity"])
        return drawn | {"severity": zone["severity"]}

    async def _until_known(self, zone_id: str) -> None:
        """Wait for the tick that takes a drawn zone in."""
        try:
            async with (
                asyncio.timeout(TAKEN_IN_S),
                self.service.subscribe(self.mission) as stream,
            ):
                async for message in stream:
                    zones = message["zones"] if message["type"] == "snapshot" else ()
                    if any(zone["id"] == zone_id for zone in zones):
                        return
        except TimeoutError:
            words = f"Zone {zone_id} is drawn, but not taken in yet: set its severity again."
            raise refusal(words) from None

    async def _pin(self, pin_id: str, robot_id: int, target_id: int, wanted: PairState) -> Json:
        forbids = wanted is PairState.FORBIDDEN
        asked = {"robot": robot_id, "target": target_id, "forbids": forbids}
        body = checked(PinRequest, asked)
        return await self._direct("pin", body.model_dump() | {"id": pin_id})

    async def _direct(self, what: str, asked: Json) -> Json:
        """Ask for directives and return the decision card, empty where nothing was judged."""
        card: Json | None = (await self._ask(what, asked)).get("decision")
        return card or {}

    async def _ask(self, what: str, asked: Json) -> Json:
        return await self.service.direct(self.mission, what, asked, self.author)

    def picture(self) -> Json:
        """Return the newest snapshot message, or refuse before the first."""
        snapshot = self.service.snapshot(self.mission)
        if snapshot is None:
            raise refusal("The mission has not begun.")
        return snapshot


def binding(pins: Iterable[Json]) -> Json:
    """Return the pin that counts among those of one pair: a person's, the newest, before others."""
    return max(enumerate(pins), key=lambda item: (item[1]["comment"] is None, item[0]))[1]


def state_of(pins: list[Json]) -> PairState:
    """Return what the pins of one pair come to."""
    if not pins:
        return PairState.FREE
    return PairState.FORBIDDEN if binding(pins)["forbids"] else PairState.PINNED


def free_pin_id(pins: Iterable[Json], robot_id: int, target_id: int) -> str:
    """Return an id for a new pin of a pair: one that no other pin has."""
    taken = {pin["id"] for pin in pins}
    base = f"r{robot_id}-t{target_id}"
    tried = base
    count = 1
    while tried in taken:
        count += 1
        tried = f"{base}-{count}"
    return tried


def price(card: Json) -> str:
    """Return the predicted price of what went into force, as a sentence; "" for none."""
    gate = card.get("gate") or {}
    difference = gate.get("difference_m2")
    if difference is None:
        return ""
    if abs(difference) < 0.001:
        return " No difference is predicted."
    better = "better" if difference < 0 else "worse"
    return f" Predicted: {abs(difference):.3g} m² {better}."


def refusal(words: str) -> ServiceError:
    """Return the error for what people ask for and is not done."""
    return ServiceError("invalid_request", words, HTTPStatus.UNPROCESSABLE_ENTITY)


def whole(title: str, value: float | None) -> int:
    """Return a whole number out of a field of a form."""
    if value is None or not 0 <= value < 2**31 or value != int(value):
        raise refusal(f"{title}: a whole number, 0 or more.")
    return int(value)


def checked(kind: type[_Body], values: Mapping[str, Any]) -> _Body:
    """Return a request's body, or refuse it naming each field and its range."""
    try:
        return kind.model_validate(dict(values))
    except ValidationError as error:
        raise refusal(" ".join(problems(error))) from None


def problems(error: ValidationError) -> list[str]:
    """Return what is wrong with a body: per field one sentence."""
    found = []
    for problem in error.errors()[:SHOWN_PROBLEMS]:
        where = ".".join(str(part) for part in problem["loc"])
        words = problem["msg"].removeprefix("Value error, ")
        found.append(f"{where}: {words}." if where else f"{words[:1].upper()}{words[1:]}.")
    return found
