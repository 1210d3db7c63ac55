import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import erfinv

from console import drawing
from console.drawing import Draft
from solver.zones import Zone, ZoneKind

DEFAULTS = {
    "sensing": {"margin": 0.1, "risk": 0.1},
    "communication": {"margin": 0.2, "risk": 0.05},
}
WHOLE = Draft("sensing", 1.0, 2.0, 3.0, 1.5, 30.0)


@pytest.mark.parametrize("risk", [0.01, 0.05, 0.1, 0.4])
def test_the_quantile_is_the_papers(risk: float) -> None:
    assert drawing.quantile(risk) == pytest.approx(math.sqrt(2.0) * erfinv(1.0 - 2.0 * risk))


@pytest.mark.parametrize("risk", [None, 0.2])
def test_robots_keep_out_of_what_was_drawn_and_the_margin(risk: float | None) -> None:
    """Along each axis the rim of the zone lies where it was drawn."""
    body = replace(WHOLE, risk=risk).zone(DEFAULTS)
    zone = Zone(
        "h1", ZoneKind.SENSING, body["mean"], body["covariance"], 0.1, body.get("risk", 0.1)
    )
    values, vectors = np.linalg.eigh(np.asarray(zone.covariance))
    assert (zone.quantile() * np.sqrt(values)).tolist() == pytest.approx([1.5, 3.0])
    angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0
    assert angle == pytest.approx(30.0)


def test_what_is_left_out_is_the_scenarios() -> None:
    assert WHOLE.zone(DEFAULTS).keys() == {"kind", "mean", "covariance"}
    assert replace(WHOLE, margin=0.5, risk=0.2).zone(DEFAULTS)["margin"] == 0.5


@given(
    st.floats(0.05, 1000.0),
    st.floats(0.05, 1000.0),
    st.floats(-180.0, 180.0),
    st.floats(0.001, 0.4),
)
def test_every_draft_without_problems_makes_a_covariance(
    long: float, short: float, angle: float, risk: float
) -> None:
    draft = Draft("communication", 0.0, 0.0, long, short, angle, None, risk)
    assert draft.problems() == {}
    covariance = np.asarray(draft.covariance(DEFAULTS))
    assert covariance[0, 1] == covariance[1, 0]
    expected = sorted((np.array([long, short]) / drawing.quantile(risk)) ** 2)
    assert np.linalg.eigvalsh(covariance) == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("x_m", None, "East: a number from -1e+06 to 1e+06 m."),
        ("y_m", math.nan, "North: nan is not within -1e+06 to 1e+06 m."),
        ("long_m", 0.0, "Semi-axis a: 0 is not within 0.05 to 1000 m."),
        ("short_m", 2e3, "Semi-axis b: 2000 is not within 0.05 to 1000 m."),
        ("angle_deg", 200.0, "Angle: 200 is not within -180 to 180 °."),
        ("margin", -1.0, "Margin: -1 is not within 0 to 1000."),
        ("risk", 0.5, "Risk: 0.5 is not within 0.001 to 0.4."),
        ("kind", "gravity", "Kind: sensing or communication."),
    ],
)
def test_each_problem_names_its_field_and_range(field: str, value: object, words: str) -> None:
    assert replace(WHOLE, **{field: value}).problems() == {field: words}  # type: ignore[arg-type]


def test_two_clicks_draw_a_circle_and_a_third_begins_anew() -> None:
    draft = Draft("communication")
    assert drawing.hint(draft) == "Click the centre on the ground."
    draft = drawing.clicked(draft, (1.0, 2.0))
    assert (draft.x_m, draft.y_m, draft.long_m) == (1.0, 2.0, None)
    assert drawing.hint(draft) == "Now click the rim."
    draft = drawing.clicked(draft, (4.0, 6.0))
    assert (draft.long_m, draft.short_m, draft.kind) == (5.0, 5.0, "communication")
    assert draft.placed
    assert "draw it" in drawing.hint(draft)
    draft = drawing.clicked(draft, (0.5, 0.5))
    assert (draft.x_m, draft.long_m, draft.placed) == (0.5, None, False)


def test_a_rim_clicked_on_the_centre_is_the_smallest_zone() -> None:
    draft = drawing.clicked(drawing.clicked(Draft(), (1.0, 1.0)), (1.0, 1.0))
    assert draft.long_m == drawing.LEAST_SIZE_M


def test_a_ray_meets_the_ground() -> None:
    assert drawing.ground_point((0.0, -10.0, 10.0), (0.0, 1.0, -1.0), 20.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((0.0, 0.0, 10.0), (0.0, 1.0, 0.0)),  # along the ground
        ((0.0, 0.0, 10.0), (0.0, 1.0, 0.5)),  # into the sky
        ((0.0, 0.0, 10.0), (0.0, 1.0, -1e-6)),  # at the horizon
        ((0.0, 0.0, math.inf), (0.0, 0.0, -1.0)),
        ((0.0, 0.0, 10.0), (math.nan, 0.0, -1.0)),
    ],
)
def test_a_click_beside_the_ground_is_none(
    origin: drawing.Point3, direction: drawing.Point3
) -> None:
    assert drawing.ground_point(origin, direction, 20.0) is None
