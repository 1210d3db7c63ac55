"""Steering in person against the service, whose mission follows a script."""

from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio

from console.steering import PairState, Steering, checked, free_pin_id, price, state_of, whole
from server.api.directing_models import ZoneRequest
from server.api.errors import ServiceError
from server.api.models import MissionRequest
from tests.server.api.serving import Stage
from tests.server.waiting import eventually

PIN = {"id": "a", "robot": 21, "target": 122, "comment": None, "forbids": False}


@pytest_asyncio.fixture
async def stage() -> AsyncIterator[Stage]:
    stage = Stage()
    async with stage.service as service:
        await service.create(MissionRequest(scenario="scripted"), "operator")
        await service.start("m1", "operator")
        await eventually(lambda: service.snapshot("m1") is not None)
        yield stage


@pytest.fixture
def hand(stage: Stage) -> Steering:
    return Steering(stage.service, "m1", "ada")


def pins(hand: Steering) -> list[tuple[int, int, bool]]:
    return [
        (pin["robot"], pin["target"], pin["forbids"])
        for pin in hand.picture()["directives"]["pins"]
    ]


def asked(stage: Stage) -> dict[str, Any]:
    """Return the last thing that the mission was asked for."""
    return next(params for op, params in stage.planners[0].requests[::-1] if op == "override")


@pytest.mark.asyncio
async def test_a_pair_goes_from_free_to_pinned_to_apart_to_free(hand: Steering) -> None:
    assert (await hand.turn(21, 122)).startswith("D21 and T122 stay together")
    await eventually(lambda: pins(hand) == [(21, 122, False)])
    assert (await hand.turn(21, 122)).startswith("D21 and T122 are kept apart")
    await eventually(lambda: pins(hand) == [(21, 122, True)])
    assert (await hand.turn(21, 122)).startswith("D21 and T122 are free again")
    await eventually(lambda: pins(hand) == [])


@pytest.mark.asyncio
async def test_a_pin_of_a_comment_becomes_a_persons(hand: Steering, stage: Stage) -> None:
    await stage.service.comment("m1", "The Drone 21 should focus on 122.", "bob")
    await eventually(lambda: pins(hand) == [(21, 122, False)])
    await hand.turn(21, 122)
    await eventually(lambda: pins(hand) == [(21, 122, True)])
    assert hand.picture()["directives"]["pins"][0]["comment"] is None


@pytest.mark.asyncio
async def test_everything_asked_for_carries_its_author(hand: Steering, stage: Stage) -> None:
    await hand.weigh({"tracking": 20.0, "control": 0.05, "sensing": 50.0, "communication": 50.0})
    assert asked(stage) == {
        "what": "weights",
        "asked": {"weights": [20.0, 0.05, 50.0, 50.0]},
        "author": "ada",
    }
    await hand.allow(21, 3)
    assert asked(stage)["asked"] == {"capacities": {"21": 3}}
    await hand.weigh_zone("s1", 2.0)
    assert asked(stage)["asked"]["severity"] == 2.0


@pytest.mark.asyncio
async def test_what_verification_refuses_is_told_in_its_words(hand: Steering) -> None:
    values = {"tracking": 1000.0, "control": 0.05, "sensing": 50.0, "communication": 50.0}
    with pytest.raises(ServiceError, match=r"Weight 1 \(tracking\) must be between 1 and 100"):
        await hand.weigh(values)


@pytest.mark.asyncio
async def test_an_erased_zone_comes_back_with_its_severity(hand: Steering) -> None:
    await hand.weigh_zone("s1", 2.5)
    await eventually(lambda: hand.picture()["zones"][0]["severity"] == 2.5)
    erased = await hand.erase("s1")
    await eventually(lambda: [z["id"] for z in hand.picture()["zones"]] == ["c1"])
    back = await hand.restore(erased)
    await eventually(lambda: hand.picture()["zones"][-1]["severity"] == 2.5)
    zone = hand.picture()["zones"][-1]
    for key in ("kind", "mean", "covariance", "margin", "risk"):
        assert zone[key] == erased[key]
    assert zone["id"] == back["id"] != "s1"


@pytest.mark.asyncio
async def test_a_zone_that_nobody_knows_cannot_be_erased(hand: Steering) -> None:
    with pytest.raises(ServiceError, match="The team knows no zone z9"):
        await hand.erase("z9")


@pytest.mark.asyncio
async def test_an_ended_mission_is_not_steered(hand: Steering, stage: Stage) -> None:
    await stage.service.stop("m1", "bob")
    with pytest.raises(ServiceError, match="cannot be directed"):
        await hand.turn(21, 122)


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ({"kind": "gravity", "mean": (0, 0), "covariance": ((1, 0), (0, 1))}, "kind"),
        ({"kind": "sensing", "mean": (1e9, 0.0), "covariance": ((1.0, 0.0), (0.0, 1.0))}, "mean.0"),
        ({"kind": "sensing", "mean": (0.0, 0.0)}, "covariance"),
    ],
)
def test_a_body_that_does_not_fit_names_its_field(values: dict[str, Any], field: str) -> None:
    with pytest.raises(ServiceError, match=f"{field}: ") as refused:
        checked(ZoneRequest, values)
    assert refused.value.code == "invalid_request"


@pytest.mark.parametrize("value", [None, 1.5, -1.0, 2.0**31, float("nan"), float("inf")])
def test_only_a_whole_number_is_one(value: float | None) -> None:
    with pytest.raises(ServiceError, match="Drone: a whole number, 0 or more"):
        whole("Drone", value)
    assert whole("Drone", 21.0) == 21


def test_a_persons_newest_pin_of_a_pair_counts() -> None:
    comment = PIN | {"id": "b", "comment": "c1", "forbids": True}
    assert state_of([]) is PairState.FREE
    assert state_of([PIN, comment]) is PairState.PINNED
    assert state_of([PIN, PIN | {"id": "c", "forbids": True}]) is PairState.FORBIDDEN
    assert state_of([comment]) is PairState.FORBIDDEN


def test_a_new_pin_takes_an_id_that_is_free() -> None:
    assert free_pin_id([], 21, 122) == "r21-t122"
    taken = [{"id": "r21-t122"}, {"id": "r21-t122-2"}]
    assert free_pin_id(taken, 21, 122) == "r21-t122-3"


@pytest.mark.parametrize(
    ("gate", "words"),
    [
        (None, ""),
        ({"difference_m2": None}, ""),
        ({"difference_m2": 0.0}, " No difference is predicted."),
        ({"difference_m2": 0.25}, " Predicted: 0.25 m² worse."),
        ({"difference_m2": -1.5}, " Predicted: 1.5 m² better."),
    ],
)
def test_the_predicted_price_is_told(gate: dict[str, Any] | None, words: str) -> None:
    assert price({"gate": gate}) == words
