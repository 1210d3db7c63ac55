"""A live mission's figures: counted in one go, or kept and gone on with after a crash."""

import json
from dataclasses import replace
from typing import Any

import pytest

from server.live.figures import FiguresError, LiveFigures, read_figures
from server.result import LoopTally
from solver.problem import Rung
from solver.snapshot import Snapshot, SolveSummary
from solver.zones import ZoneKind
from tests.server.builders import mission_setup
from tests.server.scripted import ROBOTS, TARGETS, snapshot
from vehicles.messages import HitsPart, TrueRobotPart, TrueTargetPart, Truth, WorldState

TICKS = 60
CUT = 25


def tick(number: int) -> Snapshot:
    rung = Rung.CONVERGED if number % 10 else Rung.FEASIBLE
    return snapshot(0.1 * number, solve=SolveSummary(rung, 1.0, 3, 0.001 * (1 + number % 7)))


def truth(number: int, hits: int, step: int | None = None) -> Truth:
    """Return the scripted team, each robot 10 cm beside where it says it is."""
    picture = snapshot(0.1 * number)
    robots = tuple(
        TrueRobotPart(
            id=robot,
            position=(x + 0.1, y),
            velocity=(0.0, 0.0),
            altitude_m=1.0,
            sensing_failed=False,
            jammed=False,
        )
        for robot, (x, y) in zip(ROBOTS, picture.robots.positions.tolist(), strict=True)
    )
    targets = tuple(
        TrueTargetPart(id=target, position=(x, y + 0.2), velocity=(0.0, 0.0))
        for target, (x, y) in zip(TARGETS, picture.tracks.positions.tolist(), strict=True)
    )
    return Truth(
        v=1,
        boot="b",
        seq=number,
        stamp_s=0.0,
        time_s=0.1 * number,
        step=number if step is None else step,
        state=WorldState.RUNNING,
        robots=robots,
        targets=targets,
        zones=(),
        hits=HitsPart(sensing=hits, communication=2 * hits),
    )


def account(calls: int) -> dict[str, LoopTally]:
    tally = LoopTally(calls=calls, tries=2 * calls, valid=calls)
    for _ in range(calls):
        tally.latency_s.add(1.5)
    return {"task": tally}


def result(figures: LiveFigures, calls: int, wall_s: float) -> dict[str, Any]:
    found = figures.result(tick(TICKS), account(calls), wall_s)
    return {**found, "optimizer": {**found["optimizer"], "median_ms": None, "p99_ms": None}}


def kept(figures: LiveFigures) -> LiveFigures:
    """Return figures that go on from the JSON of a checkpoint."""
    text = json.dumps(figures.kept(account(4), 2.5))
    return LiveFigures.after(mission_setup(), read_figures(json.loads(text)))


@pytest.mark.parametrize("world", ["lives on", "starts again", "is not there"])
def test_figures_after_a_crash_are_those_of_the_whole_flight(world: str) -> None:
    def told(number: int, *, again: bool) -> Truth | None:
        if world == "is not there":
            return None
        if again and world == "starts again":
            return truth(number, hits=number - CUT, step=number - CUT)
        return truth(number, hits=number)

    whole, first = LiveFigures(mission_setup()), LiveFigures(mission_setup())
    for number in range(1, TICKS + 1):
        whole.add(tick(number), told(number, again=False))
    for number in range(1, CUT + 1):
        first.add(tick(number), told(number, again=False))
    second = kept(first)
    for number in range(CUT + 1, TICKS + 1):
        second.add(tick(number), told(number, again=True))
    found, expected = result(second, 3, 3.5), result(whole, 7, 6.0)
    assert found["steps"] == TICKS
    assert found["task_llm"]["calls"] == 7
    assert found["optimizer"]["rungs"]["feasible"] == TICKS // 10
    for name, value in expected.items():
        if isinstance(value, float):
            assert found[name] == pytest.approx(value), name
        else:
            assert found[name] == value, name


def test_a_world_that_starts_again_in_flight_adds_its_hits() -> None:
    figures = LiveFigures(mission_setup())
    figures.add(tick(1), truth(1, hits=3))
    figures.add(tick(2), truth(2, hits=1, step=0))
    assert figures.hits() == {ZoneKind.SENSING: 4, ZoneKind.COMMUNICATION: 8}
    again = kept(kept(figures))
    assert again.hits() == figures.hits()


def test_what_are_no_figures_is_told_by_field() -> None:
    values = LiveFigures(mission_setup()).kept({}, 0.0)
    with pytest.raises(FiguresError, match="wall_s"):
        read_figures(values | {"wall_s": "long"})
    with pytest.raises(FiguresError, match="trace"):
        read_figures({name: value for name, value in values.items() if name != "trace"})


def test_lockstep_setups_have_another_tick() -> None:
    setup = replace(mission_setup(), tick_s=0.4)
    assert LiveFigures(setup).result(tick(1), {}, 0.0)["dt"] == setup.live_tick_s
