"""The small linear algebra of the kernels, against what defines it and against LAPACK."""

import numpy as np
import pytest

from solver.arrays import FloatArray
from solver.engines.fast.factors import (
    cholesky,
    factor_indefinite,
    solve_absolute,
    substitute,
)

# The first test compiles the kernels.
pytestmark = pytest.mark.timeout(900)

SIZES = (1, 2, 3, 5, 8)


def absolute(matrix: FloatArray) -> FloatArray:
    """Return the inverse of P L |D| L' P', column by column."""
    size = len(matrix)
    room = np.full((size + 2, size + 2), np.nan)
    room[:size, :size] = matrix
    order, pairs = np.zeros(size + 2, dtype=np.int64), np.zeros(size + 2, dtype=np.int64)
    factor_indefinite(room, size, order, pairs)
    columns = []
    for column in np.eye(size):
        vector = np.concatenate((column, [0.0, 0.0]))
        solve_absolute(room, size, order, pairs, vector, np.empty(size + 2))
        columns.append(vector[:size])
    assert sorted(order[:size].tolist()) == list(range(size))
    return np.stack(columns, axis=1)


def indefinite(seed: int, size: int) -> FloatArray:
    """Return a matrix with curvatures of both signs; every third one has a diagonal of zeros."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(size, size))
    matrix += matrix.T
    if seed % 3 == 0 and size > 1:
        np.fill_diagonal(matrix, 0.0)
    return matrix


@pytest.mark.parametrize("size", SIZES)
def test_absolute_curvatures_keep_the_matrix_and_lose_its_signs(size: int) -> None:
    """M = P L |D| L' P' is positive definite and M H^-1 M = H, since |D| D^-1 |D| = D."""
    for seed in range(12):
        H = indefinite(seed, size)
        inverse = absolute(H)
        np.testing.assert_allclose(inverse, inverse.T, atol=1e-8 * np.abs(inverse).max())
        M = np.linalg.inv(inverse)
        assert np.linalg.eigvalsh(M)[0] > 0.0
        np.testing.assert_allclose(
            M @ np.linalg.solve(H, M), H, atol=1e-7 * (1.0 + np.abs(M).max() ** 2)
        )


@pytest.mark.parametrize("size", SIZES)
def test_a_positive_definite_matrix_is_solved_as_it_is(size: int) -> None:
    rng = np.random.default_rng(size)
    root = rng.normal(size=(size, size + 1))
    H, b = root @ root.T, rng.normal(size=size)
    np.testing.assert_allclose(absolute(H), np.linalg.inv(H), rtol=1e-6)
    room, vector = np.full((size + 2, size + 2), np.nan), np.full(size + 2, np.nan)
    room[:size, :size], vector[:size] = H, b
    assert cholesky(room, size)
    np.testing.assert_allclose(np.tril(room[:size, :size]), np.linalg.cholesky(H), rtol=1e-8)
    substitute(room, size, vector)
    np.testing.assert_allclose(vector[:size], np.linalg.solve(H, b), rtol=1e-6)


@pytest.mark.parametrize(
    "values", [(1.0, 0.0), (1.0, -1e-3), (1.0, 1e-10), (-1.0, 2.0), (0.0, 0.0)]
)
def test_what_is_not_clearly_positive_is_refused(values: tuple[float, float]) -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    assert not cholesky(turn @ np.diag(values) @ turn.T, 2)
    assert cholesky(turn @ np.diag([1.0, 1e-3]) @ turn.T, 2)


def test_curvatures_that_vanish_count_as_tiny_ones() -> None:
    inverse = absolute(np.diag([4.0, 0.0, -2.0]))
    np.testing.assert_allclose(np.diag(inverse), [0.25, 1.0 / 4e-7, 0.5])
    assert np.isfinite(absolute(np.zeros((3, 3)))).all()
    flat = absolute(np.array([[1.0, 1.0], [1.0, 1.0]]))
    assert np.isfinite(flat).all()
    assert np.linalg.eigvalsh(flat)[0] > 0.0
