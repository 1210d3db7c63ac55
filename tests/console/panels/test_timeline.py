"""The banner and the controls of the timeline, drawn without a browser."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from console.board import Facts
from console.looking import Looking
from console.panels.timeline import banner, controls, scrubber, what
from console.workshop import Workshop
from server.api.errors import ServiceError
from server.api.models import Clock, MissionInfo
from server.api.service import MissionService
from server.encoding import MissionState
from tests.console.messages import message
from tests.console.panels.test_library import EVIL, mission


class Shelf:
    """Knows missions by id."""

    def __init__(self, *known: MissionInfo) -> None:
        self._known = {one.id: one for one in known}

    def mission(self, mission_id: str) -> MissionInfo:
        return self._known[mission_id]


def facts(live: MissionInfo, other: MissionInfo | None = None, **look: Any) -> Facts:
    service = cast("MissionService", Shelf(live, *([] if other is None else [other])))
    looking = Looking(service, lambda _: None, lambda: None)
    looking.steered = live
    if other is not None:
        looking._chosen = other.id
    looking.at_s, looking.by = look.get("at_s"), look.get("by", "")
    workshop = Workshop(lambda: None, lambda: None)  # type: ignore[arg-type, return-value]
    picture = message(30.0) | {"state": "running", "replay": {"speed": 5.0}}
    return Facts(live, message(165.0), picture, looking, workshop, service)


FLYING = mission(1, state=MissionState.RUNNING)


def test_the_present_has_no_banner() -> None:
    assert banner(facts(FLYING)) == ""


def test_an_instant_that_is_gone_is_named_and_live_goes_on() -> None:
    html = banner(facts(FLYING, at_s=83.0, by="ada"))
    assert "Looking at 1:23<" in html
    assert "live goes on: 2:45" in html
    assert "ada" in html
    assert 'data-tap="look:live"' in html


@pytest.mark.parametrize(
    ("at_s", "words"), [(None, "Looking at demo (m2, ended)"), (83.0, "Looking at 1:23 of demo")]
)
def test_another_mission_is_named(at_s: float | None, words: str) -> None:
    assert words in banner(facts(FLYING, mission(2), at_s=at_s))


def test_a_replay_is_played_from_the_timeline() -> None:
    replay = mission(2, clock=Clock.REPLAY)
    html = controls(facts(FLYING, replay))
    assert what(facts(FLYING, replay)) == "replay of demo (m2)"
    assert 'data-tap="replay:pause"' in html
    assert 'data-tap="replay:speed:5" aria-pressed="true"' in html
    assert 'data-tap="replay:speed:1" aria-pressed="false"' in html
    assert controls(facts(FLYING)) == ""


def test_names_are_never_run() -> None:
    evil = mission(1, scenario=EVIL, state=MissionState.RUNNING)
    for html in (what(facts(evil)), banner(facts(FLYING, evil, at_s=1.0, by=EVIL))):
        assert "<script>" not in html


def test_of_a_mission_removed_a_moment_ago_nothing_is_kept() -> None:
    def kept_from_s(mission_id: str) -> float:
        raise ServiceError("mission_unknown", f"There is no mission {mission_id}.", 404)

    seen = facts(FLYING)
    hindsight = SimpleNamespace(kept_from_s=kept_from_s)
    board: Any = SimpleNamespace(
        looking=seen.looking, picture=seen.picture, service=SimpleNamespace(hindsight=hindsight)
    )
    assert scrubber(board) == {
        "until": 30, "at": None, "kept": None, "away": False, "replay": False
    }  # fmt: skip
