from dataclasses import replace

import pytest

from llm.history import History, HistoryEntry
from solver.observations import Attack
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from tests.llm.builders import hardware

HIT = Attack(21, ZoneKind.SENSING, None, 1.0)


def at(time_s: float, *attacks: Attack) -> Snapshot:
    return replace(hardware(), time_s=time_s, attacks=attacks).snapshot()


def test_an_entry_tells_states_assignment_and_trace() -> None:
    entry = HistoryEntry.of(at(3.0, HIT))
    assert [robot.robot_id for robot in entry.robots] == [21, 26]
    assert entry.targets[0].velocity == (0.1, 0.0)
    assert entry.attacks == (HIT,)
    assert entry.trace == 0.42
    assert len(entry.assignment) == 2


def test_the_last_five_results_are_kept() -> None:
    history = History(spacing_s=1.0)
    for k in range(9):
        history.record(at(float(k)))
    assert [entry.time_s for entry in history.entries] == [4.0, 5.0, 6.0, 7.0, 8.0]


@pytest.mark.parametrize("step_s", [0.1, 0.2, 0.5, 1.0])
def test_results_are_their_spacing_apart(step_s: float) -> None:
    history = History(spacing_s=1.0)
    for k in range(round(4.0 / step_s) + 1):
        history.record(at(k * step_s))
    times = [entry.time_s for entry in history.entries]
    assert times == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])


def test_no_attack_is_lost_between_two_results() -> None:
    history = History(spacing_s=1.0)
    for k in range(12):
        history.record(at(0.1 * k, *((HIT,) if k in (3, 7, 11) else ())))
    assert [len(entry.attacks) for entry in history.entries] == [0, 2]
    assert history.latest_attacks == (HIT,)
