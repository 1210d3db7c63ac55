"""Quaternions against scipy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.arrays import FloatArray
from vehicles.localization import rotations


def ours(rotation: Rotation) -> FloatArray:
    return np.asarray(rotation.as_quat()[..., [3, 0, 1, 2]], dtype=np.float64)


def same(q: FloatArray, rotation: Rotation) -> bool:
    """Tell whether a quaternion is the rotation; q and -q are one."""
    return bool(np.allclose(np.abs((q * ours(rotation)).sum(axis=-1)), 1.0, atol=1e-12))


@pytest.fixture
def dice() -> np.random.Generator:
    return np.random.default_rng(5)


def test_product_and_turning(dice: np.random.Generator) -> None:
    a, b = Rotation.random(20, dice), Rotation.random(20, dice)
    vectors = dice.normal(size=(20, 3))
    assert same(rotations.product(ours(a), ours(b)), a * b)
    assert same(rotations.product(ours(a[0]), ours(b)), a[0] * b)
    assert rotations.turned(ours(a), vectors) == pytest.approx(a.apply(vectors))
    assert rotations.turned(ours(a[0]), vectors) == pytest.approx(a[0].apply(vectors))
    assert same(rotations.conjugate(ours(a)), a.inv())


def test_vectors_and_back(dice: np.random.Generator) -> None:
    scale = np.array([0.0, 1e-12, 1e-9, 1e-7, 1e-3, 1.0, 3.0])[:, None]
    direction = np.array([0.6, 0.0, -0.8])
    turns = scale * direction
    assert same(rotations.of_vector(turns), Rotation.from_rotvec(turns))
    assert rotations.vector_of(rotations.of_vector(turns)) == pytest.approx(turns, abs=1e-15)
    assert rotations.vector_of(-rotations.of_vector(turns)) == pytest.approx(turns, abs=1e-15)


def test_yaw(dice: np.random.Generator) -> None:
    angles = np.linspace(-3.0, 3.0, 13)
    assert rotations.yaw_of(rotations.about_up(angles)) == pytest.approx(angles)
    tilted = Rotation.from_euler("ZYX", np.column_stack((angles, 0.3 + 0 * angles, 0.1 * angles)))
    assert rotations.yaw_of(ours(tilted)) == pytest.approx(angles)


def test_matrices(dice: np.random.Generator) -> None:
    some = Rotation.random(10, dice)
    assert rotations.matrix_of(ours(some)) == pytest.approx(some.as_matrix())
