"""Closed forms against LAPACK."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from solver import matrices

entry = st.floats(-1e6, 1e6, allow_subnormal=False)


@given(entry, entry, entry)
def test_clamped_eigenvalues_are_inside_and_directions_stay(a: float, b: float, c: float) -> None:
    matrix = np.array([[[a, b], [b, c]]])
    values, vectors = np.linalg.eigh(matrix[0])
    lower, upper = 1e-6, 1e4
    expected = (vectors * np.clip(values, lower, upper)) @ vectors.T
    result = matrices.clamped(matrix, lower, upper)[0]
    # An indefinite matrix of size 1e6 is known to some 1e-10 only: compare at its own scale.
    np.testing.assert_allclose(result, expected, atol=1e-6 * min(max(values.max(), 1.0), upper))
    assert np.linalg.eigvalsh(result)[0] > 0.0


def test_what_is_inside_is_not_touched() -> None:
    stack = np.stack([np.eye(2), np.diag([3.0, 1e-3])])
    assert matrices.clamped(stack, 1e-6, 1e4) is stack


def test_inverse_of_a_stack() -> None:
    rng = np.random.default_rng(0)
    factors = rng.normal(size=(50, 2, 2))
    stack = factors @ np.swapaxes(factors, 1, 2) + 0.1 * np.eye(2)
    np.testing.assert_allclose(matrices.inverse(stack), np.linalg.inv(stack), rtol=1e-8)
