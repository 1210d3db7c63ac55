"""The chaos suite, short: some faults, a planted bug for each invariant, and the schedule.

`make chaos` does the same for longer, with every kind of fault and several seeds.
"""

import json
from collections.abc import AsyncIterator
from dataclasses import replace
from itertools import islice
from time import monotonic

import pytest
import pytest_asyncio

from server.mission.checkpoint import checkpoint_text, read_checkpoint
from server.mission.core import MissionCore
from server.scenarios import library
from solver.observations import Comment
from solver.snapshot import CommentReceipt
from tests.chaos.inside import without
from tests.chaos.plants import PLANTS, plant
from tests.chaos.repertoire import FAULTS
from tests.chaos.run import Outcome, examine, struck
from tests.chaos.schedule import Kind, Strike, schedule
from tests.chaos.team import OUTSIDE, Team, team
from tests.chaos.watch import Invariant

SEED = 0
STRUCK = (Kind.KILL_VEHICLE, Kind.STOP_PLANNER, Kind.GARBLE_BUS, Kind.FILL_DISK, Kind.KILL_SERVER)

flying = [
    pytest.mark.process,
    pytest.mark.browser,
    pytest.mark.timeout(600),
    pytest.mark.asyncio(loop_scope="module"),
]


def strikes(*kinds: Kind) -> list[Strike]:
    """Return the first strike of each kind in the seed's schedule."""
    drawn = list(islice(schedule(SEED, "sqlite", OUTSIDE), len(Kind)))
    return [next(strike for strike in drawn if strike.kind is kind) for kind in kinds]


@pytest_asyncio.fixture(scope="module", loop_scope="module", name="made")
async def _made(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Team]:
    async with team(tmp_path_factory.mktemp("chaos"), SEED, "sqlite") as made:
        yield made


class TestFlying:
    pytestmark = flying

    async def test_what_must_hold_holds_whatever_is_broken(self, made: Team) -> None:
        outcome, began_s = Outcome(SEED, "sqlite", made.disk.kind), monotonic()
        for strike in strikes(*STRUCK):
            outcome.rows.append(await struck(made, strike, began_s))
        await examine(made, outcome)
        assert outcome.violations == []
        assert all(row.report for row in outcome.rows)
        assert all(outcome.checks[one.value] > 0 for one in Invariant), outcome.checks

    @pytest.mark.parametrize("invariant", PLANTS)
    async def test_a_planted_bug_is_caught(self, made: Team, invariant: Invariant) -> None:
        caught = await plant(made, invariant)
        assert caught.caught, caught.planted


def test_a_bug_is_planted_for_every_invariant() -> None:
    assert set(PLANTS) == set(Invariant)


def test_a_dropped_comment_is_in_no_checkpoint_any_more() -> None:
    kept = MissionCore(library.load("ablation").mission_setup()).checkpoint()
    one, other, third = (
        CommentReceipt(Comment(f"c{number}", "Track more boldly.", 0.0, 120.0))
        for number in (1, 2, 3)
    )
    kept = replace(kept, standing=(one, other), closed=(third,))
    bare = json.loads(without({"core": checkpoint_text(kept), "time_s": 0.0}, "c2"))
    assert read_checkpoint(bare["core"]) == replace(kept, standing=(one,))
    bare = json.loads(without({"core": checkpoint_text(kept)}, "c3"))
    assert read_checkpoint(bare["core"]) == replace(kept, closed=())


def test_every_kind_of_fault_can_be_done() -> None:
    assert set(FAULTS) == set(Kind)


@pytest.mark.parametrize("database", ["sqlite", "postgresql"])
def test_one_seed_is_one_schedule(database: str) -> None:
    drawn = [list(islice(schedule(seed, database, OUTSIDE), 60)) for seed in (3, 3, 4)]
    assert drawn[0] == drawn[1]
    assert drawn[0] != drawn[2]
    left_out = set(Kind) - {strike.kind for strike in drawn[0]}
    assert left_out == ({Kind.FILL_DISK} if database == "postgresql" else set())
