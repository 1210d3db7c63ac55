"""People's own steering of a live mission: verified, priced, attributed, on the tape."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import pytest

from server.live.channel import RequestRefused
from server.live.mission import ITERATIONS
from server.live.solving import Resolver
from server.mission.setup import GateMode, MeritSetup
from server.mission.tape import replay
from solver import engines
from solver.directives import Pairing
from solver.planner import Planner
from tests.server.live.flights import (
    ENGINE,
    DeadModel,
    Flight,
    flight,
    hardware_setup,
    mock_model,
)
from tests.server.live.virtual import run
from tests.server.waiting import eventually

WEIGHTS = [12.0, 0.05, 60.0, 60.0]
ONE_TO_ONE = {"assignment": {"21": [122], "26": [124]}}
KEEP = {"id": "keep", "robot": 21, "target": 124, "forbids": False, "ttl_s": None}


def flown(act: Callable[[Flight], Awaitable[None]], **options: Any) -> None:
    """Fly for two seconds, then act."""

    async def fly() -> None:
        async with flight(**options) as f:
            await f.until(2.0)
            await act(f)

    run(fly())


async def refused(asking: Awaitable[Any], code: str) -> RequestRefused:
    with pytest.raises(RequestRefused) as caught:
        await asking
    assert caught.value.code == code
    return caught.value


def test_weights_of_a_person_are_in_force_at_the_next_tick_with_their_price() -> None:
    async def act(f: Flight) -> None:
        answer = await f.mission.override("weights", {"weights": WEIGHTS}, "ada")
        card = answer["decision"]
        assert card["status"] == "adopted"
        assert card["author"] == "ada"
        assert card["loop"] == "people"
        assert card["changes"]["weights"]["tracking"] == [5.0, 12.0]
        assert card["gate"]["judgement"] in {"better", "not_worse", "clearly_worse"}
        assert card["gate"]["difference_m2"] is not None
        assert list(f.core.core.directives.weights) == WEIGHTS
        again = await f.mission.override("weights", {"weights": WEIGHTS}, "ada")
        assert again["decision"]["gate"]["judgement"] == "unchanged"

    flown(act)


def test_the_price_is_told_with_the_gate_off_too() -> None:
    async def act(f: Flight) -> None:
        answer = await f.mission.override("weights", {"weights": WEIGHTS}, "ada")
        assert answer["decision"]["gate"]["difference_m2"] is not None

    flown(act, setup=hardware_setup(gate=GateMode.OFF))


def test_a_person_passes_the_gate_with_what_is_clearly_worse() -> None:
    async def act(f: Flight) -> None:
        lower, upper = f.setup.weight_lower, f.setup.weight_upper
        bad = [lower.tracking, upper.control, lower.sensing, lower.communication]
        answer = await f.mission.override("weights", {"weights": bad}, "ada")
        assert answer["decision"]["status"] == "adopted"
        assert answer["decision"]["gate"]["judgement"] == "clearly_worse"

    strict = replace(hardware_setup(), merit=MeritSetup(margin=0.0))
    flown(act, setup=strict)


def test_what_verification_forbids_is_refused_in_words_and_changes_nothing() -> None:
    async def act(f: Flight) -> None:
        before = f.core.core.directives
        error = await refused(
            f.mission.override("weights", {"weights": [1e6, 0.05, 50.0, 50.0]}, "ada"),
            "override_refused",
        )
        assert "Weight 1 (tracking) must be between" in error.message
        assert error.details["field"] == "weights"
        assert error.details["decision"]["refused_by"] == "verification"
        rows = {"assignment": {"21": [122]}}
        error = await refused(f.mission.override("assignment", rows, "ada"), "override_refused")
        assert "no drone" in error.message
        assert f.core.core.directives == before

    flown(act)


def test_a_pin_moves_its_target_and_binds_later_proposals() -> None:
    async def act(f: Flight) -> None:
        await f.mission.override("assignment", ONE_TO_ONE, "ada")
        answer = await f.mission.override("pin", KEEP, "ada")
        assert answer["decision"]["changes"]["pins_set"][0]["id"] == "keep"
        assert Pairing(21, 124) in f.core.core.directives.assignment
        error = await refused(
            f.mission.override("assignment", ONE_TO_ONE, "ada"), "override_refused"
        )
        assert error.details["violations"] == [
            "Drone 21 must keep Target 124: the operator fixed it."
        ]
        again = await f.mission.override("pin", KEEP, "ada")
        assert again["decision"]["gate"]["judgement"] == "unchanged"
        lifted = await f.mission.override("unpin", {"id": "keep"}, "ada")
        assert lifted["decision"]["changes"]["pins_lifted"] == ["keep"]
        assert f.core.core.directives.pins == ()
        await refused(f.mission.override("unpin", {"id": "keep"}, "ada"), "pin_unknown")

    flown(act)


def test_a_pin_of_a_robot_that_is_not_there_is_refused() -> None:
    async def act(f: Flight) -> None:
        asked = {"id": "p", "robot": 99, "target": 121, "forbids": False, "ttl_s": None}
        error = await refused(f.mission.override("pin", asked, "ada"), "override_refused")
        assert "There is no Drone 99" in error.message

    flown(act)


def test_a_lower_capacity_takes_the_assignment_along() -> None:
    async def act(f: Flight) -> None:
        robot = max(f.setup.robot_ids, key=lambda r: len(f.core.core.directives.targets_of(r)))
        wanted = len(f.core.core.directives.targets_of(robot)) - 1
        asked = {"capacities": {str(robot): wanted}}
        answer = await f.mission.override("capacities", asked, "ada")
        assert answer["decision"]["status"] == "adopted"
        assert dict(f.core.core.directives.capacities)[robot] == wanted
        assert len(f.core.core.directives.targets_of(robot)) == wanted

    flown(act)


def test_zones_are_drawn_changed_and_erased() -> None:
    async def act(f: Flight) -> None:
        asked = {"kind": "sensing", "mean": [3.0, 3.0], "covariance": [[0.2, 0.0], [0.0, 0.2]]}
        zone = (await f.mission.override("zone", asked, "ada"))["zone"]
        assert zone["id"] == "h1"
        assert "h1" in {z.id for z in f.core.snapshot.zones}
        change = {"id": "h1", "severity": 2.0, "mean": [3.5, 3.0]}
        answer = await f.mission.override("zone_change", change, "ada")
        assert answer["decision"]["changes"]["severities"] == {"h1": [1.0, 2.0]}
        assert next(z.mean for z in f.core.snapshot.zones if z.id == "h1") == (3.5, 3.0)
        lower = {"id": "h1", "severity": 1.0}
        assert (await f.mission.override("zone_change", lower, "ada"))["decision"]
        high = {"id": "h1", "severity": 50.0}
        await refused(f.mission.override("zone_change", high, "ada"), "override_refused")
        await f.mission.override("zone_erase", {"id": "h1"}, "ada")
        assert "h1" not in {z.id for z in f.core.snapshot.zones}
        await refused(f.mission.override("zone_erase", {"id": "h1"}, "ada"), "zone_unknown")
        assert "Ada drew zone h1" in f.words()

    flown(act)


def test_overrides_are_decided_while_mission_time_stands_still() -> None:
    async def act(f: Flight) -> None:
        f.mission.pause("ada")
        answer = await f.mission.override("weights", {"weights": WEIGHTS}, "ada")
        assert answer["decision"]["status"] == "adopted"

    flown(act)


def test_a_zone_drawn_while_mission_time_stands_still_is_known_when_it_goes_on() -> None:
    async def act(f: Flight) -> None:
        f.mission.pause("ada")
        await asyncio.sleep(0.5)  # the tick that was due passes
        asked = {"kind": "sensing", "mean": [3.0, 3.0], "covariance": [[0.2, 0.0], [0.0, 0.2]]}
        assert (await f.mission.override("zone", asked, "ada"))["zone"]["id"] == "h1"
        assert not f.core.snapshot.zones
        f.mission.resume("ada")
        await f.until(f.core.snapshot.time_s + 0.3)
        assert [zone.id for zone in f.core.snapshot.zones] == ["h1"]

    flown(act)


def test_a_zone_drawn_as_the_mission_ends_is_refused_and_holds_nothing_up() -> None:
    async def act(f: Flight) -> None:
        f.mission.pause("ada")
        await asyncio.sleep(0.3)
        asked = {"kind": "sensing", "mean": [1.0, 1.0], "covariance": [[0.2, 0.0], [0.0, 0.2]]}
        drawing = asyncio.create_task(f.mission.override("zone", asked, "ada"))
        await asyncio.sleep(0.5)
        await f.mission.stop("ada")
        await refused(drawing, "wrong_state")

    flown(act)


def test_a_mission_steered_by_people_replays_bit_for_bit() -> None:
    async def fly() -> Any:
        async with mock_model() as model, flight(model) as f:
            await f.until(2.0)
            await f.mission.override("weights", {"weights": WEIGHTS}, "ada")
            await f.mission.override("assignment", ONE_TO_ONE, "ada")
            await f.mission.override("pin", KEEP | {"ttl_s": 3.0}, "ada")
            zone = {"kind": "sensing", "mean": [3.0, 3.0], "covariance": [[0.2, 0.0], [0.0, 0.2]]}
            await f.mission.override("zone", zone, "ada")
            await f.until(8.0)
            await f.mission.override("zone_erase", {"id": "h1"}, "ada")
            await f.until(12.0)
            return f.setup, f.tape.entries

    setup, entries = run(fly())
    again = list(replay(setup, entries, Resolver(Planner(engines.create(ENGINE)), ITERATIONS)))
    assert len(again) >= 120
    assert set(again) == {None}


def test_a_decision_that_waits_is_approved_or_refused_by_a_person() -> None:
    async def fly() -> None:
        setup = hardware_setup(gate=GateMode.CONFIRM, merit=MeritSetup(approval_s=1000.0))
        async with mock_model() as model, flight(model, setup=setup) as f:
            f.mission.comment("The drone 21 should focus on tracking target 122", "ada", "c1")
            card = await pending(f, after=())
            await f.until(f.core.snapshot.time_s + 0.3)
            assert f"{card['loop']}_llm" in waiting_loops(f)
            before = f.core.core.directives
            answer = await f.mission.override("approval", asked(card, approve=False), "ada")
            assert answer["decision"]["refused_by"] == "person"
            assert answer["decision"]["approval"]["by"] == "ada"
            assert f.core.core.directives == before
            await f.until(f.core.snapshot.time_s + 0.3)
            assert f"{card['loop']}_llm" not in waiting_loops(f)
            other = await pending(f, after=(card["id"],))
            answer = await f.mission.override("approval", asked(other, approve=True), "ada")
            assert answer["decision"]["status"] == "adopted"
            assert f.core.core.directives != before
            error = await refused(
                f.mission.override("approval", asked(other, approve=True), "ada"), "not_pending"
            )
            assert error.details["decision"]["status"] == "adopted"
            unknown = {"id": "d999", "approve": True}
            await refused(f.mission.override("approval", unknown, "ada"), "decision_unknown")

    run(fly())


def test_our_solver_assigns_when_the_task_model_has_been_silent_for_two_periods() -> None:
    async def fly() -> Any:
        setup = hardware_setup()
        async with flight(DeadModel(), setup=setup) as f:
            period_s = setup.loops.task_period_s
            await f.until(2.0 * period_s - 1.0)
            assert all(said["guidance"]["level"] != "solver" for said in f.snapshots)
            await f.until(2.0 * period_s + 2.0)
            assert f.snapshots[-1]["guidance"]["level"] == "solver"
            return f.events

    events = run(fly())
    cards = [e["data"]["decision"] for e in events if e["kind"] == "decision"]
    assert any(card["source"] == "exact" and card["status"] == "adopted" for card in cards)
    assert any(card["refused_by"] == "no_answer" for card in cards)


async def pending(f: Flight, after: tuple[str, ...]) -> dict[str, Any]:
    """Return the first decision that waits for a person."""

    def waiting() -> list[dict[str, Any]]:
        cards = {
            e["data"]["decision"]["id"]: e["data"]["decision"]
            for e in f.events
            if e["kind"] == "decision"
        }
        return [c for c in cards.values() if c["status"] == "pending" and c["id"] not in after]

    await eventually(lambda: bool(waiting()), within_s=200.0)
    return waiting()[0]


def waiting_loops(f: Flight) -> list[str]:
    """Return the loops that say that they wait for a person."""
    return [name for name, loop in f.snapshots[-1]["loops"].items() if loop["waits_for_person"]]


def asked(card: dict[str, Any], *, approve: bool) -> dict[str, Any]:
    return {"id": card["id"], "approve": approve}
