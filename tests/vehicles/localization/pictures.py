"""Pictures of real tag36h11 markers, drawn from the family's own definition.

The definition is the one compiled into the detector's library; the drawing, the projection and
the light are ours.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pupil_apriltags import Detector  # type: ignore[import-untyped]
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from solver.arrays import FloatArray
from vehicles.localization.tags import Camera, Picture

WIDTH, HEIGHT = 480, 360
FINE = 2
"""Rays per pixel and axis."""


@dataclass(frozen=True)
class Placed:
    """A tag in front of the camera."""

    tag_id: int
    size_m: float
    place: FloatArray
    turn: Rotation
    """From tag to camera."""


@dataclass(frozen=True)
class Family:
    """Definition of a family of tags."""

    codes: tuple[int, ...]
    bits: tuple[tuple[int, int], ...]
    """Column and row of each bit, from the corner of the black border, most significant first."""

    border_cells: int
    """Width of the black border's outer edge: the size of a tag."""

    all_cells: int
    """Width with the white margin."""


@lru_cache
def family() -> Family:
    """Return tag36h11 as the detector's library defines it."""
    detector = Detector(families="tag36h11")
    found = detector.tag_families["tag36h11"].contents
    return Family(
        codes=tuple(int(found.codes[k]) for k in range(found.ncodes)),
        bits=tuple((int(found.bit_x[k]), int(found.bit_y[k])) for k in range(found.nbits)),
        border_cells=int(found.width_at_border),
        all_cells=int(found.total_width),
    )


def marker(tag_id: int) -> FloatArray:
    """Return the cells of a marker with its white margin: 1 white, 0 black, row 0 on top."""
    drawn = family()
    margin = (drawn.all_cells - drawn.border_cells) // 2
    cells = np.ones((drawn.all_cells, drawn.all_cells))
    cells[margin:-margin, margin:-margin] = 0.0
    for number, (column, row) in enumerate(drawn.bits):
        value = drawn.codes[tag_id] >> (len(drawn.bits) - 1 - number) & 1
        cells[row + margin, column + margin] = float(value)
    return cells


def picture(camera: Camera, tags: list[Placed], dice: np.random.Generator) -> Picture:
    """Return what the camera sees: tags before a grey wall, slightly blurred, with noise."""
    columns = (np.arange(WIDTH * FINE) + 0.5) / FINE
    rows = (np.arange(HEIGHT * FINE) + 0.5) / FINE
    u, v = np.meshgrid(columns, rows)
    rays = np.stack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)), -1)
    light = np.full(u.shape, 0.45)
    for tag in tags:
        _draw(light, rays, tag)
    fine = gaussian_filter(light, 0.5 * FINE)
    grey = fine.reshape(HEIGHT, FINE, WIDTH, FINE).mean(axis=(1, 3))
    grey = 30.0 + 190.0 * grey + dice.normal(0.0, 2.0, grey.shape)
    return np.asarray(np.clip(np.round(grey), 0, 255), dtype=np.uint8)


def _draw(light: FloatArray, rays: FloatArray, tag: Placed) -> None:
    """Paint a tag where the rays meet its plane."""
    turn = tag.turn.as_matrix()
    normal = turn[:, 2]
    along = (normal @ tag.place) / (rays @ normal)
    local = (along[..., None] * rays - tag.place) @ turn
    cells = marker(tag.tag_id)
    cell_m = tag.size_m / family().border_cells
    column = np.floor(local[..., 0] / cell_m + len(cells) / 2).astype(int)
    row = np.floor(local[..., 1] / cell_m + len(cells) / 2).astype(int)
    inside = (along > 0) & (column >= 0) & (column < len(cells)) & (row >= 0) & (row < len(cells))
    light[inside] = cells[row[inside], column[inside]]
