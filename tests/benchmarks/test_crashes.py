"""The server is killed at random moments of a live mission; `benchmarks.crashes` does it often."""

import random
from pathlib import Path
from typing import Any, cast

import pytest

from benchmarks.crashes import Broken, Campaign, Server, Vehicles, campaign, decided_since


@pytest.mark.process
@pytest.mark.timeout(400)
@pytest.mark.asyncio
async def test_nothing_acknowledged_is_lost_when_the_server_is_killed(tmp_path: Path) -> None:
    async with campaign("hardware", tmp_path, seed=2) as killed:
        for _ in range(3):
            await killed.round()
        assert killed.comments


EMPTY: dict[str, Any] = {"assignment": [], "weights": {}, "capacities": {}, "severities": {}}


def told(assignment: dict[str, list[int]], time_s: float) -> dict[str, Any]:
    directives = {"assignment": assignment, "weights": {"tracking": 1.0}}
    return {
        "time_s": time_s,
        "zones": [{"id": "z1"}],
        "directives": {**directives, "capacities": {"21": 2, "26": 2}, "severities": {"z1": 1.0}},
    }


def card(decided_s: float, status: str = "adopted") -> dict[str, Any]:
    rows = [{"robot": 21, "gains": [], "loses": [124]}, {"robot": 26, "gains": [], "loses": [122]}]
    changes = EMPTY | {"assignment": rows}
    return {"status": status, "decided_s": decided_s, "changes": changes}


BOTH = {"21": [122, 124], "26": [122, 124]}
ONE_EACH = {"21": [122], "26": [124]}


@pytest.mark.parametrize(
    ("after", "cards", "broken"),
    [
        (told(BOTH, 12.0), [], ""),
        (told(ONE_EACH, 12.0), [card(10.4)], ""),
        (told(BOTH, 12.0), [card(10.4)], ""),
        (told(ONE_EACH, 12.0), [], "assignment is"),
        (told(ONE_EACH, 12.0), [card(9.0)], "assignment is"),
        (told(ONE_EACH, 12.0), [card(10.4, status="refused")], "assignment is"),
        (told(BOTH, 3.0), [], "time went back"),
        (told(BOTH, 12.0) | {"zones": []}, [], "zones are missing"),
    ],
)
def test_a_mission_must_go_on_as_it_was_seen_or_as_was_decided_since(
    after: dict[str, Any], cards: list[dict[str, Any]], broken: str
) -> None:
    vehicles = Vehicles(cast(Any, None), cast(Any, None), cast(Any, None))
    seen = Campaign(Server([], {}), vehicles, "", random.Random(0))
    seen.seen.append(told(BOTH, 10.0))
    seen.settled = 1
    if broken:
        with pytest.raises(Broken, match=broken):
            seen.compare(after, [], cards)
    else:
        seen.compare(after, [], cards)


def test_what_was_seen_after_the_last_acknowledgement_may_be_lost_with_the_server() -> None:
    vehicles = Vehicles(cast(Any, None), cast(Any, None), cast(Any, None))
    seen = Campaign(Server([], {}), vehicles, "", random.Random(0))
    seen.seen += [told(BOTH, 10.0), told(ONE_EACH, 13.0)]
    seen.settled = 1
    for kept in (told(BOTH, 9.5), told(ONE_EACH, 12.5)):
        seen.compare(kept, [], [])
    seen.settled = 2
    with pytest.raises(Broken, match="assignment is"):
        seen.compare(told(BOTH, 12.5), [], [])


def test_a_severity_that_is_lifted_is_no_longer_told() -> None:
    severe = told(BOTH, 10.0)
    severe["directives"]["severities"] = {"z1": 2.0}
    lifted = card(10.4) | {"changes": {**EMPTY, "severities": {"z1": [2.0, 1.0]}}}
    (now,) = decided_since(severe, [lifted])
    assert now["severities"] == {}


def test_an_acknowledged_comment_must_be_there_as_it_was_said() -> None:
    vehicles = Vehicles(cast(Any, None), cast(Any, None), cast(Any, None))
    seen = Campaign(Server([], {}), vehicles, "", random.Random(0), comments={"c1": "Keep clear."})
    seen.compare(told(BOTH, 12.0), [{"id": "c1", "text": "Keep clear."}], [])
    with pytest.raises(Broken, match="comments are missing"):
        seen.compare(told(BOTH, 12.0), [{"id": "c2", "text": "Keep clear."}], [])
