"""The evidence on attacks: bounded, faded, told in windows."""

import numpy as np
import pytest

from solver.encounters import CELL_M, MOST_CELLS, MOST_MARKS, Encounters, Layer

LOWER, UPPER = (-10.0, -6.0), (10.0, 6.0)


def one(x: float, y: float) -> np.ndarray:
    return np.array([[x, y]])


def test_marks_in_a_cell_are_one_mark_at_their_centre_of_gravity() -> None:
    encounters = Encounters(LOWER, UPPER, 600.0)
    encounters.add(Layer.CLEAR, one(1.01, 2.01), np.array([1.0]))
    encounters.add(Layer.CLEAR, one(1.11, 2.21), np.array([3.0]))
    clear = encounters.near((1.0, 2.0), 1.0).clear
    assert clear.weights == pytest.approx([4.0])
    assert clear.points == pytest.approx(np.array([[1.085, 2.16]]))


def test_a_window_shows_its_own_layers_and_nothing_from_afar() -> None:
    encounters = Encounters(LOWER, UPPER, 600.0)
    encounters.add(Layer.HIT, np.array([[0.0, 0.0], [8.0, 5.0]]), np.array([1.0, 1.0]))
    encounters.add(Layer.INSIDE, one(0.5, 0.0), np.array([40.0]))
    encounters.add(Layer.OUTSIDE, one(-0.5, 0.0), np.array([2.0]))
    evidence = encounters.near((0.0, 0.0), 2.0)
    assert evidence.hits.points == pytest.approx(np.array([[0.0, 0.0]]))
    assert evidence.inside.weights.tolist() == [1.0], "the same answer, however often asked"
    assert evidence.outside.weights.tolist() == [1.0]
    assert evidence.clear.weights.size == 0


def test_evidence_fades_and_a_long_mission_overflows_nothing() -> None:
    encounters = Encounters(LOWER, UPPER, 60.0)
    encounters.add(Layer.HIT, one(0.0, 0.0), np.array([2.0]))
    encounters.fade(60.0)
    encounters.add(Layer.HIT, one(5.0, 0.0), np.array([2.0]))
    hits = encounters.near((0.0, 0.0), 1.0).hits
    assert hits.weights == pytest.approx([2.0 / np.e])
    for _ in range(1000):
        encounters.fade(60.0)
    encounters.add(Layer.HIT, one(5.0, 0.0), np.array([2.0]))
    assert encounters.near((5.0, 0.0), 1.0).hits.weights == pytest.approx([2.0])


def test_any_length_of_time_may_pass_at_once() -> None:
    encounters = Encounters(LOWER, UPPER, 10.0)
    encounters.add(Layer.HIT, one(0.0, 0.0), np.array([2.0]))
    encounters.fade(1e6)
    assert encounters.near((0.0, 0.0), 1.0).hits.weights.sum() < 1e-200
    encounters.add(Layer.HIT, one(0.0, 0.0), np.array([3.0]))
    assert encounters.near((0.0, 0.0), 1.0).hits.weights == pytest.approx([3.0])


def test_many_marks_are_put_together_and_lose_neither_weight_nor_balance() -> None:
    dice = np.random.default_rng(1)
    points = dice.uniform((-4.0, -4.0), (4.0, 4.0), (20_000, 2))
    encounters = Encounters(LOWER, UPPER, 600.0)
    encounters.add(Layer.CLEAR, points, np.full(len(points), 0.1))
    clear = encounters.near((0.0, 0.0), 4.2).clear
    assert 0 < len(clear.weights) <= MOST_MARKS
    assert clear.weights.sum() == pytest.approx(2000.0)
    assert clear.weights @ clear.points == pytest.approx(0.1 * points.sum(axis=0))


def test_a_field_of_kilometres_has_larger_cells_and_marks_beyond_it_count_at_its_rim() -> None:
    vast = Encounters((0.0, 0.0), (5000.0, 3000.0), 600.0)
    assert vast.cell_m == pytest.approx(5000.0 / MOST_CELLS)
    assert Encounters(LOWER, UPPER, 600.0).cell_m == CELL_M
    vast.add(Layer.HIT, one(-3.0, 9000.0), np.array([1.0]))
    assert vast.near((0.0, 3000.0), 5.0).hits.points == pytest.approx(np.array([[-3.0, 9000.0]]))


def test_forgetting_is_local() -> None:
    encounters = Encounters(LOWER, UPPER, 600.0)
    encounters.add(Layer.HIT, np.array([[0.0, 0.0], [8.0, 5.0]]), np.array([1.0, 1.0]))
    encounters.forget((0.0, 0.0), 2.0)
    assert encounters.near((0.0, 0.0), 2.0).hits.weights.size == 0
    assert encounters.near((8.0, 5.0), 2.0).hits.weights.tolist() == [1.0]


@pytest.mark.parametrize("place", [(-8.0, 0.0), (8.0, 0.0), (0.0, -5.0), (0.0, 5.0)])
def test_a_window_ends_on_every_side(place: tuple[float, float]) -> None:
    encounters = Encounters(LOWER, UPPER, 600.0)
    encounters.add(Layer.HIT, np.array([[0.0, 0.0], place]), np.array([1.0, 1.0]))
    assert encounters.near((0.0, 0.0), 2.0).hits.points == pytest.approx(np.array([[0.0, 0.0]]))
    encounters.forget((0.0, 0.0), 2.0)
    assert encounters.near(place, 2.0).hits.weights.tolist() == [1.0]
