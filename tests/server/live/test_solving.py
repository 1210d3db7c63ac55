import asyncio
import threading
from dataclasses import replace

import numpy as np
import pytest

from server.live.solving import Resolver, SolveThread, timed
from server.mission.core import MissionCore
from server.mission.tape import Committed, MemoryTape, TapedCore, replay
from server.recording.topics import ENTRY
from solver import engines
from solver.arrays import frozen
from solver.bounds import rollout
from solver.planner import Planner
from solver.problem import Budget, Problem, Rung, Solution
from tests.patience import PATIENCE_S
from tests.server.builders import mission_setup
from tests.server.waiting import eventually

BUDGET = Budget(iterations=50)


def problem() -> Problem:
    return MissionCore(mission_setup()).begin(0.0)


class Gate:
    """An engine that answers only while the gate is open."""

    name = "gate"

    def __init__(self) -> None:
        self.open = threading.Event()
        self.calls = 0
        self._engine = engines.create("sqp")

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        self.calls += 1
        self.open.wait(20.0)
        return self._engine.solve(problem, budget)


@pytest.mark.asyncio
async def test_a_solve_in_time_is_the_planners() -> None:
    planner = Planner(engines.create("sqp"))
    asked = problem()
    with SolveThread(planner) as solver:
        solution = await solver.solve(asked, BUDGET, 20.0)
    assert solution.rung is Rung.CONVERGED
    assert np.array_equal(solution.controls, planner.solve(asked, BUDGET).controls)
    assert solver.stuck == 0


@pytest.mark.asyncio
async def test_a_stuck_solve_is_not_waited_for_and_not_asked_again_until_it_is_back() -> None:
    gate = Gate()
    asked = problem()
    with SolveThread(Planner(gate)) as solver:
        first = await solver.solve(asked, BUDGET, 0.02)
        second = await solver.solve(asked, BUDGET, 20.0)
        assert first.rung is second.rung is Rung.BRAKE
        assert np.array_equal(first.controls, np.zeros_like(first.controls))
        await eventually(lambda: gate.calls == 1)  # its thread may have been slow to wake
        assert solver.stuck == 1
        gate.open.set()
        async with asyncio.timeout(PATIENCE_S):
            solution = second
            while solution.rung is Rung.BRAKE:
                await asyncio.sleep(0.01)
                solution = await solver.solve(asked, BUDGET, 20.0)
        assert solution.rung is Rung.CONVERGED
        assert gate.calls == 2, "nobody asked while it was stuck"


@pytest.mark.asyncio
async def test_a_process_can_end_while_a_solve_hangs() -> None:
    with SolveThread(Planner(Gate())) as solver:
        await solver.solve(problem(), BUDGET, 0.02)
    hanging = [thread for thread in threading.enumerate() if thread.name == "solve"]
    assert hanging
    assert all(thread.daemon for thread in hanging)


def test_carrying_on_is_no_failure_of_the_engine(caplog: pytest.LogCaptureFixture) -> None:
    """A solve that hangs is told of once, not ten times a second."""
    planner = Planner(Gate())
    asked = problem()
    assert planner.carry_on(asked).rung is Rung.BRAKE
    plan = Planner(engines.create("sqp")).solve(asked, BUDGET)
    shifted = planner.carry_on(replace(asked, previous=plan.controls))
    assert shifted.rung is Rung.SHIFTED
    assert np.array_equal(shifted.controls, plan.controls)
    assert not caplog.records


@pytest.mark.parametrize(("deadline_s", "late"), [(None, False), (1e6, False), (0.0, True)])
def test_a_solve_is_late_when_its_deadline_has_passed(deadline_s: float | None, late: bool) -> None:
    planner = Planner(engines.create("sqp"))
    assert timed(planner, problem(), Budget(50, deadline_s)).late is late


def test_a_mission_whose_solves_were_cut_short_replays_bit_for_bit() -> None:
    """Every third solve ends somewhere that no count of iterations tells."""
    setup = mission_setup()
    tape = MemoryTape()
    core = TapedCore(MissionCore(setup), tape)
    planner = Planner(engines.create("sqp"))
    for tick in range(12):
        asked = core.begin(0.1 * tick)
        solution = planner.solve(asked, BUDGET)
        if tick % 3 == 2:
            controls = 0.5 * solution.controls
            positions, velocities = rollout(asked, controls)
            solution = replace(
                solution,
                rung=Rung.FEASIBLE,
                controls=frozen(controls),
                positions=frozen(positions),
                velocities=frozen(velocities),
                late=True,
            )
        core.commit(solution)
    stored = [ENTRY.validate_json(ENTRY.dump_json(entry)) for entry in tape.entries]
    assert stored == tape.entries
    resolver = Resolver(Planner(engines.create("sqp")), BUDGET.iterations)
    assert list(replay(setup, stored, resolver)) == [None] * 12
    forgotten = [
        replace(entry, plan=None) if isinstance(entry, Committed) else entry for entry in stored
    ]
    assert any(difference is not None for difference in replay(setup, forgotten, resolver))


@pytest.mark.parametrize("rung", [Rung.SHIFTED, Rung.BRAKE])
def test_a_tick_that_was_not_solved_live_is_not_solved_on_replay(rung: Rung) -> None:
    planner = Planner(engines.create("sqp"))
    directives = mission_setup().initial_directives()
    recorded = Committed(0, rung, (), directives)
    assert Resolver(planner, 50)(problem(), recorded).rung is Rung.BRAKE
