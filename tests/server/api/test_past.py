from typing import Any

from server.api.past import PACK_BYTES, Past
from server.live.channel import frame


def told(time_s: float | None, padding: int = 0) -> Any:
    return frame({"type": "snapshot", "time_s": time_s, "padding": "x" * padding})


def test_pictures_a_second_apart_are_kept_and_found() -> None:
    past = Past()
    for tick in range(301):
        past.take(told(tick / 10))
    assert past.from_s == 0.0
    for asked_s, found_s in ((0.0, 0.0), (7.9, 7.0), (8.0, 8.0), (30.0, 30.0), (99.0, 30.0)):
        picture = past.at(asked_s)
        assert picture is not None
        assert picture["time_s"] == found_s
    assert past.at(-0.5) is None


def test_the_oldest_go_first_by_number_and_by_bytes() -> None:
    few = Past(max_pictures=10)
    small = Past(max_bytes=5 * (PACK_BYTES + 100))
    for second in range(100):
        few.take(told(float(second)))
        small.take(told(float(second), padding=PACK_BYTES))  # long: kept as it is
        assert small.size_bytes <= 5 * (PACK_BYTES + 100)
    assert few.from_s == 90.0
    assert few.at(89.0) is None
    assert small.from_s == 95.0
    picture = small.at(97.5)
    assert picture is not None
    assert len(picture["padding"]) == PACK_BYTES


def test_a_mission_of_half_an_hour_takes_little() -> None:
    past = Past()
    for second in range(3600):
        past.take(told(float(second), padding=10_000))
    assert past.from_s == 1800.0
    assert past.size_bytes < 2**20


def test_mission_time_that_goes_back_or_is_unknown_confuses_nothing() -> None:
    past = Past()
    past.take(told(None))
    assert past.at(1e9) is None
    past.take(told(50.0))
    past.take(told(2.0))
    assert past.from_s == 2.0
    past.clear()
    assert (past.at(2.0), past.size_bytes) == (None, 0)
