"""Meshes and poses of the scene's signs, as plain arrays (frame ENU, metres)."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles: vertices (V, 3) and faces (F, 3)."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


def joined(*parts: Mesh) -> Mesh:
    """Return one mesh of several."""
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + o for part, o in zip(parts, offsets, strict=True)]).astype(
            np.uint32
        ),
    )


def moved(mesh: Mesh, offset: tuple[float, float, float]) -> Mesh:
    """Return a mesh elsewhere."""
    return Mesh(mesh.vertices + np.asarray(offset, dtype=np.float32), mesh.faces)


def ring(inner: float, outer: float = 1.0, corners: int = 48) -> Mesh:
    """Return a flat ring around the origin, both faces of it visible with side=double."""
    angles = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], axis=1)
    i = np.arange(corners)
    j = (i + 1) % corners
    faces = np.concatenate(
        [np.stack([i, i + corners, j + corners], 1), np.stack([i, j + corners, j], 1)]
    )
    vertices = np.concatenate([inner * circle, outer * circle])
    return Mesh(vertices.astype(np.float32), faces.astype(np.uint32))


def disc(radius: float = 1.0, corners: int = 48) -> Mesh:
    """Return a flat disc around the origin."""
    angles = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    rim = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], axis=1)
    i = np.arange(corners)
    faces = np.stack([np.full(corners, corners), i, (i + 1) % corners], axis=1)
    vertices = np.concatenate([rim, np.zeros((1, 3))])
    return Mesh(vertices.astype(np.float32), faces.astype(np.uint32))


def box(size: tuple[float, float, float]) -> Mesh:
    """Return a box around the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    vertices = 0.5 * corners * np.asarray(size)
    return Mesh(vertices.astype(np.float32), np.array(faces, dtype=np.uint32))


@cache
def drone() -> Mesh:
    """Return a quadrotor of about one metre: body, two crossed arms, four rotors."""
    reach = 0.36
    arm = box((2.0 * reach, 0.06, 0.05))
    turned = []
    for angle in (np.pi / 4, -np.pi / 4):
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=np.float32)
        turned.append(Mesh(arm.vertices @ rotation.T, arm.faces))
    corner = reach / np.sqrt(2.0)
    rotors = [
        moved(ring(0.14, 0.19, 20), (x * corner, y * corner, 0.06))
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    return joined(box((0.24, 0.24, 0.12)), *turned, *rotors)


@cache
def diamond() -> Mesh:
    """Return an octahedron of radius one."""
    vertices = np.array(
        [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float32
    )
    faces = [
        (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (1, 0, 5), (2, 1, 5), (3, 2, 5), (0, 3, 5)
    ]  # fmt: skip
    return Mesh(vertices, np.array(faces, dtype=np.uint32))


def headings(angles: ArrayLike) -> Floats:
    """Return quaternions (N, 4), w first, of turns by angles (N,) around the vertical."""
    half = 0.5 * np.asarray(angles, dtype=float)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def level(count: int) -> Floats:
    """Return `count` quaternions that turn nothing."""
    return headings(np.zeros(count))


def ellipses(covariances: ArrayLike, sigmas: float = 2.0) -> tuple[Floats, Floats]:
    """Return the ellipses of covariances (N, 2, 2).

    Semi-axes (N, 2), the long one first, in metres; direction of the long one (N,), radians.
    """
    matrices = np.asarray(covariances, dtype=float).reshape(-1, 2, 2)
    values, vectors = np.linalg.eigh(matrices)
    semi_axes = sigmas * np.sqrt(np.maximum(values[:, ::-1], 0.0))
    return semi_axes, np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])
