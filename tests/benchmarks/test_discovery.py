from dataclasses import replace

from benchmarks.discovery import Job, Manner, Run, fly, table

BLIND = Run("unseen", 0, Manner.BLIND, 40, 9, 800.0, zones=4, found=0, false=0)
INFERRED = replace(
    BLIND, manner=Manner.INFERRED, sensing_attacks=8, accumulated_trace=300.0, found=3, false=1
)


def test_all_manners_fly_the_same_world() -> None:
    runs = [fly(Job("unseen", 0, manner, steps=60)) for manner in Manner]
    assert [run.manner for run in runs] == list(Manner)
    assert {run.zones for run in runs} == {4}
    blind = runs[0]
    assert (blind.found, blind.false) == (0, 0), "blind ones know nothing"
    assert all(run.accumulated_trace > 0.0 for run in runs)


def test_the_table_shows_means_and_differences_per_seed() -> None:
    more = [
        replace(run, seed=1, sensing_attacks=run.sensing_attacks + 4) for run in (BLIND, INFERRED)
    ]
    head, _, blind, inferred = table([BLIND, INFERRED, *more]).splitlines()
    assert blind.startswith("| unseen | blind | 42.0 ± ")
    assert "| 10.0 ± 25.4 (-32.0 ± 0.0) |" in inferred
    assert inferred.endswith("| 3.0 of 4 | 1.0 |")
    assert head.count("|") == inferred.count("|")
