import pytest

from tests.vehicles.mavlink.air import ORIGIN, build
from vehicles.mavlink.alignment import PAIRS, DatumAlignment, Heights
from vehicles.mavlink.frames import Datum
from vehicles.mavlink.telemetry import Telemetry

TEAM = Datum(ORIGIN.latitude_deg + 0.0002, ORIGIN.longitude_deg - 0.0003, 400.0)
OFFSET = TEAM.enu(ORIGIN.latitude_deg, ORIGIN.longitude_deg, ORIGIN.altitude_m)


def place(local: tuple[float, float, float]) -> tuple[float, float, float]:
    return ORIGIN.geodetic(local)


def test_the_told_origin_is_believed() -> None:
    told = Telemetry(origin=(ORIGIN.latitude_deg, ORIGIN.longitude_deg, ORIGIN.altitude_m))
    aligner = DatumAlignment(TEAM, Heights.DATUM)
    aligner.observe(Telemetry())
    before = aligner.alignment
    assert before is None
    aligner.observe(told)
    assert aligner.alignment is not None
    assert aligner.alignment.shift == pytest.approx(OFFSET)


def test_heights_count_from_the_own_origin_by_default() -> None:
    aligner = DatumAlignment(TEAM)
    aligner.observe(
        Telemetry(origin=(ORIGIN.latitude_deg, ORIGIN.longitude_deg, ORIGIN.altitude_m))
    )
    assert aligner.alignment is not None
    assert aligner.alignment.shift == pytest.approx((OFFSET[0], OFFSET[1], 0.0))


def test_home_serves_where_no_origin_is_told() -> None:
    local = (4.0, -2.0, 1.0)
    aligner = DatumAlignment(TEAM, Heights.DATUM)
    aligner.observe(Telemetry(home=(place(local), local)))
    assert aligner.alignment is not None
    assert aligner.alignment.shift == pytest.approx(OFFSET, abs=1e-3)


def test_pairs_serve_where_nothing_better_is_told() -> None:
    aligner = DatumAlignment(TEAM)
    told = Telemetry(position_s=1.0)
    for number in range(PAIRS):
        assert aligner.alignment is None
        local = (0.1 * number, 3.0, 2.0)
        told.position, told.boot_ms, told.global_ms = local, 1000 * number, 1000 * number + 20
        told.global_place = place(local)
        aligner.observe(told)
        aligner.observe(told)
    assert aligner.alignment is not None
    assert aligner.alignment.shift[:2] == pytest.approx(OFFSET[:2], abs=1e-3)


def test_pairs_far_apart_in_time_or_fast_are_not_pairs() -> None:
    aligner = DatumAlignment(TEAM)
    for number in range(3 * PAIRS):
        told = Telemetry(
            position_s=1.0,
            boot_ms=1000 * number,
            global_ms=1000 * number + (500 if number % 2 else 10),
            velocity=(0.0, 0.0 if number % 2 else 3.0, 0.0),
            global_place=place((0.0, 0.0, 0.0)),
        )
        aligner.observe(told)
    assert aligner.alignment is None


def test_two_vehicles_agree_on_where_they_are() -> None:
    """A vehicle whose local frame starts elsewhere is at the same place of the common frame."""
    here = build(aligner=DatumAlignment(TEAM), home=(5.0, 7.0, 0.0))
    here.run(3.0)
    state = here.session.state(here.now_s)
    assert state is not None
    assert state.position == pytest.approx((OFFSET[0] + 5.0, OFFSET[1] + 7.0), abs=0.02)
