"""What is done, what is kept, what is told, however a campaign ends."""

from pathlib import Path

import pytest
from distributed import LocalCluster

from server.experiments.campaign import (
    Done,
    Failed,
    Workers,
    WorkersUnavailable,
    outcomes,
)
from server.experiments.store import TrialStore
from tests.server.experiments.fakes import Counted, Deadly, Threads

MANY = Workers(jobs=2)


@pytest.fixture
def store(tmp_path: Path) -> TrialStore:
    store = TrialStore(tmp_path / "out")
    store.open()
    return store


def _trials(folder: Path, count: int = 3) -> list[Counted]:
    return [Counted(f"t{i}", folder, value=float(i)) for i in range(count)]


def test_what_is_kept_is_not_done_again(tmp_path: Path, store: TrialStore) -> None:
    trials = _trials(tmp_path)
    first = list(outcomes(trials, store, Workers()))
    again = list(outcomes(trials, store, Workers()))
    assert [o.result["value"] for o in first if isinstance(o, Done)] == [0.0, 1.0, 2.0]
    assert first == again
    assert [trial.times_done() for trial in trials] == [1, 1, 1]


def test_a_campaign_broken_off_goes_on_where_it_was(tmp_path: Path, store: TrialStore) -> None:
    trials = _trials(tmp_path, 4)
    running = outcomes(trials, store, Workers())
    assert isinstance(next(running), Done)
    assert isinstance(next(running), Done)
    running.close()
    assert len(list(outcomes(trials, store, Workers()))) == 4
    assert sorted(trial.times_done() for trial in trials) == [1, 1, 1, 1]


@pytest.mark.parametrize("workers", [Workers(), MANY], ids=["here", "processes"])
def test_a_run_that_fails_costs_no_other_and_is_tried_again(
    tmp_path: Path, store: TrialStore, workers: Workers
) -> None:
    trials = [*_trials(tmp_path), Counted("bad", tmp_path, fails=True)]
    found = list(outcomes(trials, store, workers))
    assert sorted(o.trial.label for o in found if isinstance(o, Done)) == ["t0", "t1", "t2"]
    failed = [o for o in found if isinstance(o, Failed)]
    assert [f.error for f in failed] == ["RuntimeError: bad was to fail badly"]
    assert "perform" in failed[0].details
    list(outcomes(trials, store, Workers()))
    assert [trial.times_done() for trial in trials] == [1, 1, 1, 2]


@pytest.mark.process
def test_workers_have_one_thread_for_numerics_each(store: TrialStore) -> None:
    found = list(outcomes([Threads("a"), Threads("b")], store, MANY))
    assert len(found) == 2
    for outcome in found:
        assert isinstance(outcome, Done)
        assert set(outcome.result.values()) == {"1"}


@pytest.mark.process
def test_a_worker_that_dies_is_told_of_and_what_was_done_is_kept(
    tmp_path: Path, store: TrialStore
) -> None:
    trials = _trials(tmp_path)
    list(outcomes(trials, store, MANY))
    with pytest.raises(WorkersUnavailable, match="worker"):
        list(outcomes([*trials, Deadly("d1"), Deadly("d2")], store, MANY))
    assert all(store.load(trial) is not None for trial in trials)


@pytest.mark.process
def test_a_cluster_does_the_runs(tmp_path: Path, store: TrialStore) -> None:
    trials = _trials(tmp_path)
    with LocalCluster(  # type: ignore[no-untyped-call]
        host="127.0.0.1",
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tcp",
        dashboard_address=None,
    ) as cluster:
        workers = Workers(scheduler=cluster.scheduler_address)
        found = list(outcomes(trials, store, workers))
    assert sorted(o.result["value"] for o in found if isinstance(o, Done)) == [0.0, 1.0, 2.0]


def test_a_scheduler_that_is_not_there_is_one_clear_sentence(
    tmp_path: Path, store: TrialStore
) -> None:
    workers = Workers(scheduler="tcp://127.0.0.1:9")
    with pytest.raises(WorkersUnavailable, match=r"127\.0\.0\.1:9"):
        list(outcomes(_trials(tmp_path), store, workers))
