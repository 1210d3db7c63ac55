"""The live mission in virtual time, against a simulated world and the real mock model."""

import asyncio
from itertools import pairwise
from typing import Any

import pytest

from llm.chat import ChatReply, ChatRequest, LanguageModel
from server.encoding import MissionState
from server.live.channel import RequestRefused
from server.live.mission import ITERATIONS, Terms
from server.live.solving import Resolver
from server.mission.tape import Began, Committed, replay
from solver import engines
from solver.planner import Planner
from tests.server.live.flights import ENGINE, DeadModel, flight, hardware_setup, mock_model
from tests.server.live.virtual import run
from tests.server.waiting import eventually

FOCUS = "The drone 21 should focus on tracking target 122"


def test_a_live_minute_replayed_gives_the_same_setpoints_and_directives() -> None:
    async def fly() -> Any:
        async with (
            mock_model() as model,
            flight(model, Terms("m1", comments=((10.0, FOCUS),))) as f,
        ):
            await f.until(60.0)
            return f.setup, f.tape.entries, f.events

    setup, entries, events = run(fly())
    ticks = sum(isinstance(entry, Committed) for entry in entries)
    assert ticks >= 600
    assert any(event["kind"] == "directives" for event in events)
    again = list(replay(setup, entries, Resolver(Planner(engines.create(ENGINE)), ITERATIONS)))
    assert len(again) == ticks
    assert [difference for difference in again if difference is not None] == []


def test_ticks_lie_on_the_grid() -> None:
    async def fly() -> Any:
        async with flight() as f:
            await f.until(5.0)
            return [entry.now_s for entry in f.tape.entries if isinstance(entry, Began)]

    times = run(fly())
    assert times[0] == 0.0
    assert times == pytest.approx([0.1 * k for k in range(len(times))])


def test_snapshots_leave_at_every_tick_with_truth_and_loops() -> None:
    async def fly() -> Any:
        async with mock_model() as model, flight(model) as f:
            await f.until(3.0)
            return list(f.snapshots)

    snapshots = run(fly())
    flying = [said for said in snapshots if said["state"] == "running"]
    assert [said["tick"] for said in flying] == sorted({said["tick"] for said in flying})
    last = flying[-1]
    assert last["mission"] == "m1"
    assert set(last["loops"]) == {"optimizer", "task_llm", "action_llm"}
    assert last["loops"]["optimizer"]["rate_hz"] == pytest.approx(10.0)
    assert {robot["id"] for robot in last["truth"]["robots"]} == {21, 26}
    assert all(robot["link"] == "connected" for robot in last["robots"])


def test_the_team_follows_its_setpoints() -> None:
    async def fly() -> Any:
        async with flight() as f:
            await f.until(0.2)
            before = {r.id: r.position for r in f.simulation.world.truth().robots}
            await f.until(4.0)
            after = {r.id: r.position for r in f.simulation.world.truth().robots}
            return before, after

    before, after = run(fly())
    assert all(after[robot_id] != before[robot_id] for robot_id in before)


def test_a_comment_is_answered_and_told() -> None:
    async def fly() -> Any:
        async with mock_model() as model, flight(model) as f:
            await f.until(2.0)
            receipt = f.mission.comment(FOCUS, "operator", "c1")
            await f.until(6.0)
            return receipt, f.snapshots[-1]["comments"], f.words()

    receipt, comments, words = run(fly())
    assert receipt["status"] == "received"
    assert [comment["id"] for comment in comments] == [receipt["id"]]
    assert comments[0]["status"] in ("applied", "noted", "partly_applied")
    assert comments[0]["task"]["reason"]
    assert f"Operator: {FOCUS}" in words


def test_comments_of_the_script_are_said_at_their_time() -> None:
    async def fly() -> Any:
        async with flight(terms=Terms("m1", comments=((1.0, "one"), (2.5, "two")))) as f:
            await f.until(4.0)
            return f.snapshots[-1]["comments"]

    comments = run(fly())
    assert [comment["text"] for comment in comments] == ["one", "two"]
    assert [comment["time_s"] for comment in comments] == pytest.approx([0.9, 2.4], abs=0.11)


def test_too_many_comments_are_refused() -> None:
    async def fly() -> Any:
        async with flight() as f:
            await f.until(1.0)
            for number in range(32):
                f.mission.comment(f"comment {number}", "operator", f"c{number}")
            with pytest.raises(RequestRefused) as refused:
                f.mission.comment("one more", "operator", "more")
            return refused.value.code

    assert run(fly()) == "too_many_comments"


def test_hold_stops_the_team_within_two_ticks_and_resume_lets_it_go_on() -> None:
    async def fly() -> Any:
        async with flight() as f:
            await f.until(2.0)
            assert f.mission.hold("operator") == {"state": "held"}
            held_at_s = f.core.snapshot.time_s
            await f.until(held_at_s + 0.25)
            held = f.snapshots[-1]
            still = {r.id: r.position for r in f.simulation.world.truth().robots}
            await f.until(held_at_s + 3.0)
            assert still == {r.id: r.position for r in f.simulation.world.truth().robots}
            assert f.mission.resume("operator") == {"state": "running"}
            await f.until(held_at_s + 4.0)
            return held, f.snapshots[-1]

    held, resumed = run(fly())
    assert held["state"] == "held"
    assert all(robot["setpoint"] == [0.0, 0.0] for robot in held["robots"])
    assert held["guidance"]["level"] == "hold"
    assert any(robot["setpoint"] != [0.0, 0.0] for robot in resumed["robots"])


def test_what_is_said_while_robots_are_mustered_is_what_the_mission_begins_in() -> None:
    async def fly() -> Any:
        async with flight(living="nobody") as f:
            await asyncio.sleep(0.1)
            assert f.mission.state is MissionState.CREATED
            assert f.mission.hold("operator") == {"state": "held"}
            await f.until(1.0)
            assert {said["state"] for said in f.snapshots} == {"held"}
            assert f.snapshots[-1]["guidance"]["level"] == "hold"
        async with flight(living="nobody") as f:
            await asyncio.sleep(0.1)
            assert f.mission.pause("operator") == {"state": "paused"}
            await asyncio.sleep(10.0)
            assert f.core.snapshot.tick == -1, "no mission time has passed"
            assert f.mission.resume("operator") == {"state": "running"}
            await f.until(1.0)
            return f.snapshots[-1]

    assert run(fly())["state"] == "running"


def test_mission_time_stands_still_while_paused() -> None:
    async def fly() -> Any:
        async with mock_model() as model, flight(model) as f:
            await f.until(2.0)
            f.mission.pause("operator")
            await asyncio.sleep(0.3)
            at_s, calls = f.core.snapshot.time_s, f.mission.result()["task_llm"]["calls"]
            targets = [t.position for t in f.simulation.world.truth().targets]
            await asyncio.sleep(60.0)
            assert f.core.snapshot.time_s == at_s
            assert f.mission.result()["task_llm"]["calls"] == calls
            assert [t.position for t in f.simulation.world.truth().targets] == targets
            assert f.snapshots[-1]["state"] == "paused"
            f.mission.resume("operator")
            await f.until(at_s + 2.0)
            return [entry.now_s for entry in f.tape.entries if isinstance(entry, Began)]

    times = run(fly())
    steps = [after - before for before, after in pairwise(times)]
    assert steps == pytest.approx([0.1] * len(steps))


def test_a_dead_model_costs_no_tick_and_is_told_of() -> None:
    async def fly() -> Any:
        async with flight(DeadModel()) as f:
            await f.until(30.0)
            return f.snapshots[-1]["loops"], f.words(), f.snapshots[-1]["guidance"]

    loops, words, guidance = run(fly())
    assert loops["optimizer"]["missed"] == 0
    assert loops["optimizer"]["rate_hz"] == pytest.approx(10.0)
    assert loops["task_llm"]["success_rate"] == 0.0
    assert "The task model gave no valid answer: no answer within 8 s" in words
    assert guidance["level"] == "last_valid"


def test_a_dead_model_does_not_fill_the_list_of_warnings() -> None:
    async def fly() -> Any:
        async with flight(DeadModel()) as f:
            await f.until(85.0)
            return list(f.events)

    events = run(fly())
    loops = [event for event in events if event["kind"] == "loop" and "model" in event["text"]]
    assert 2 <= len([event for event in loops if "action model" in event["text"]]) <= 3
    assert "calls in a row): no answer within 8 s" in loops[-1]["text"]
    decisions = [event for event in events if event["kind"] == "decision"]
    cards = [card for card in decisions if card["data"]["decision"]["status"] == "refused"]
    assert len(cards) >= 9, "each is kept with its reason all the same"
    assert {card["severity"] for card in cards} == {"info"}
    assert all(card["data"]["decision"]["reasons"] for card in cards)


class Stuttering:
    """Wrong at first, then as the mock has it."""

    def __init__(self, model: LanguageModel) -> None:
        self.model = model
        self.asked = 0

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        self.asked += 1
        if self.asked <= 2:
            return ChatReply("I cannot help with that.", 10, 5, 0.1)
        return await self.model.complete(request, timeout_s)


def test_every_refused_try_is_told_with_its_reason_also_where_a_retry_mends_it() -> None:
    async def fly() -> Any:
        async with mock_model() as model, flight(Stuttering(model)) as f:
            await f.until(10.0)
            return list(f.events)

    refusals = [event for event in run(fly()) if event["kind"] == "verdict"]
    assert len(refusals) == 2
    for event in refusals:
        assert event["severity"] == "info"
        assert "was refused: The answer was a refusal" in event["text"]
        assert event["data"]["fault"] == "unreadable"


def test_a_mission_ends_when_its_time_is_over() -> None:
    async def fly() -> Any:
        async with flight(setup=hardware_setup(steps=20)) as f:
            await eventually(lambda: f.mission.state is MissionState.ENDED)
            return f.events[-1], f.snapshots[-1], await f.mission.stop("operator")

    event, snapshot, stopped = run(fly())
    assert event["kind"] == "ended"
    assert event["data"]["result"]["steps"] == 20
    assert snapshot["state"] == "ended"
    assert stopped["result"]["steps"] == 20


def test_stopping_gives_the_figures_of_the_flight() -> None:
    async def fly() -> Any:
        async with mock_model() as model, flight(model) as f:
            await f.until(12.0)
            return await f.mission.stop("operator")

    result = run(fly())["result"]
    assert result["scenario"] == "hardware"
    assert result["dt"] == 0.1
    assert result["steps"] >= 120
    assert result["optimizer"]["ticks"] == result["steps"]
    assert result["trajectory_length_m"] > 0.5
    assert 0.0 < result["position_error_m"] < 1.0
    assert result["min_separation_m"] > 0.3
    assert result["action_llm"]["calls"] >= 2


def test_robots_that_never_come_are_not_waited_for_for_ever() -> None:
    async def fly() -> Any:
        async with flight(living="nobody") as f:
            await f.until(4.0)
            return f.snapshots[-1]

    snapshot = run(fly())
    assert snapshot["time_s"] >= 4.0
    assert [robot["link"] for robot in snapshot["robots"]] == ["lost", "lost"]
    assert snapshot["truth"] is None
