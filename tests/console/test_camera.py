from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from console.camera import ABOVE_PX, BELOW_PX, FILLED, LEAST_FILLED, Lens, whole_field
from tests.console.messages import message


def seen(
    said: dict[str, Any], aspect: float, height_px: float, top_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the field's corners, up to a height, are in a view: pixels from its middle."""
    fov = 1.2
    place, aim = (np.array(point) for point in whole_field(said, aspect, fov, height_px))
    ahead = (aim - place) / np.linalg.norm(aim - place)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(right, ahead)
    (x0, y0), (x1, y1) = said["field"]["lower"], said["field"]["upper"]
    corners = np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (0.0, top_m)])
    corners -= place
    pixels = 0.5 * height_px / (np.tan(0.5 * fov) * (corners @ ahead))
    return corners @ right * pixels, corners @ up * pixels


def flying(altitude_m: float) -> dict[str, Any]:
    """A snapshot whose robots fly at one altitude, but one that was never heard."""
    said = message()
    for robot in said["robots"]:
        robot["position"] = [*robot["position"][:2], altitude_m]
    said["robots"][0]["position"] = None
    return said


@pytest.mark.parametrize("altitude_m", [0.0, 2.0, 40.0])
@pytest.mark.parametrize("height_px", [390.0, 800.0])
@pytest.mark.parametrize("aspect", [0.5, 1.3, 2.4])
def test_a_view_of_any_shape_sees_the_whole_field_and_no_more_than_it_must(
    aspect: float, height_px: float, altitude_m: float
) -> None:
    across, up = seen(flying(altitude_m), aspect, height_px, altitude_m)
    beyond = (
        np.abs(across).max() / (0.5 * FILLED * aspect * height_px),
        (up.max() + ABOVE_PX) / (0.5 * height_px),
        (BELOW_PX - up.min()) / (0.5 * height_px),
    )
    assert max(beyond) == pytest.approx(1.0)


def test_a_view_too_low_for_what_lies_over_it_shows_the_field_all_the_same() -> None:
    across, up = seen(flying(2.0), 2.0, 100.0, 2.0)
    assert max(np.abs(across).max() / 100.0, np.abs(up).max() / 50.0) > LEAST_FILLED - 1e-9


def test_a_lens_sees_points_where_it_puts_them() -> None:
    lens = Lens.at((1.0, -8.0, 8.0), (1.0, 0.0, 0.0))
    assert lens.seen((1.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0))
    beside = lens.beside((3.0, 2.0, 1.0), 0.1, -0.2)
    x, y = lens.seen((3.0, 2.0, 1.0))
    assert lens.seen(beside) == pytest.approx((x + 0.1, y - 0.2))
    across, _ = lens.seen((1.0 + 0.5 * lens.span_m((1.0, 0.0, 0.0)), 0.0, 0.0))
    assert across == pytest.approx(0.5)


def test_what_is_nearer_looks_larger() -> None:
    lens = Lens.at(*whole_field(message()))
    assert lens.span_m((0.0, -5.0, 0.0)) < lens.span_m((0.0, 5.0, 0.0))
