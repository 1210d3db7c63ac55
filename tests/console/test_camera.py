import numpy as np
import pytest

from console.camera import FILLED, Lens, whole_field
from tests.console.messages import message


@pytest.mark.parametrize("aspect", [0.5, 1.3, 2.4])
def test_a_view_of_any_shape_sees_the_whole_field_and_no_more_than_it_must(aspect: float) -> None:
    said = message()
    fov = 1.2
    place, aim = (np.array(point) for point in whole_field(said, aspect, fov))
    ahead = (aim - place) / np.linalg.norm(aim - place)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(right, ahead)
    (x0, y0), (x1, y1) = said["field"]["lower"], said["field"]["upper"]
    corners = np.array([(x, y, 0.0) for x in (x0, x1) for y in (y0, y1)]) - place
    tall = np.tan(0.5 * fov) * (corners @ ahead)
    filled = np.maximum(np.abs(corners @ right) / (tall * aspect), np.abs(corners @ up) / tall)
    assert filled.max() == pytest.approx(FILLED)


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
