import numpy as np
import pytest

from console.shapes import Mesh, box, diamond, disc, drone, ellipses, headings, joined, moved, ring


@pytest.mark.parametrize("mesh", [ring(0.9), disc(), box((1, 2, 3)), drone(), diamond()])
def test_faces_name_vertices_that_exist(mesh: Mesh) -> None:
    assert mesh.vertices.shape[1] == mesh.faces.shape[1] == 3
    assert mesh.faces.max() == len(mesh.vertices) - 1
    assert np.isfinite(mesh.vertices).all()


def test_a_disc_has_the_area_of_a_circle() -> None:
    a, b, c = (
        disc(2.0, corners=400).vertices[disc(2.0, corners=400).faces[:, k]] for k in range(3)
    )
    areas = 0.5 * np.abs(np.cross(b - a, c - a)[:, 2])
    assert areas.sum() == pytest.approx(4.0 * np.pi, rel=1e-3)


def test_a_box_is_as_large_as_said() -> None:
    assert np.ptp(box((1, 2, 3)).vertices, axis=0) == pytest.approx([1, 2, 3])


def test_joining_keeps_every_part_in_its_place() -> None:
    mesh = joined(box((1, 1, 1)), moved(box((1, 1, 1)), (5.0, 0.0, 0.0)))
    second = mesh.vertices[mesh.faces[12:]]
    assert second[..., 0].min() == pytest.approx(4.5)


def test_a_heading_turns_east_to_where_it_points() -> None:
    w, x, y, z = headings([np.pi / 3])[0]
    east = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    assert east == pytest.approx([0.5, np.sqrt(3) / 2, 0.0])


def test_an_ellipse_is_the_covariances_contour() -> None:
    covariance = np.array([[0.8, 0.25], [0.25, 0.5]])
    (long, short), angle = (values[0] for values in ellipses([covariance], sigmas=2.0))
    turn = np.linspace(0.0, 2.0 * np.pi, 50)
    c, s = np.cos(angle), np.sin(angle)
    points = np.array([[c, -s], [s, c]]) @ np.array([long * np.cos(turn), short * np.sin(turn)])
    mahalanobis = np.einsum("ik,ij,jk->k", points, np.linalg.inv(covariance), points)
    assert mahalanobis == pytest.approx(np.full(50, 4.0))
    assert long >= short


def test_no_ellipses_are_none() -> None:
    axes, angles = ellipses([])
    assert axes.shape == (0, 2)
    assert angles.shape == (0,)
