"""From the first sightings to a registration that is believed."""

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.localization import SIGHTINGS, TRUE, registration_error, sightings
from benchmarks.odometry import TAGS
from vehicles.localization.drift import Drift, DriftFilter
from vehicles.localization.registration import Landmark, Registration
from vehicles.localization.seeking import Seeker, SeekSettings


def found_after(seeker: Seeker, marks: list[Landmark]) -> tuple[int, Registration]:
    for number, mark in enumerate(marks, 1):
        found = seeker.add(mark)
        if found is not None:
            return number, found
    raise AssertionError(seeker.reason)


def marks(seed: int, noise_m: float, wrong: int = 0) -> list[Landmark]:
    return sightings(np.random.default_rng(seed), np.full(SIGHTINGS, noise_m), wrong)


def test_it_registers_as_soon_as_it_is_sure() -> None:
    seeker = Seeker(SeekSettings(least=10))
    assert seeker.reason == "no tag of known place has been seen"
    number, found = found_after(seeker, marks(1, 0.05))
    assert number == 10
    assert np.linalg.norm(registration_error(found)[:3]) < 0.15
    assert seeker.reason == ""


def test_it_waits_while_it_is_not_sure() -> None:
    seeker = Seeker(SeekSettings(least=4, sure_m=0.15))
    seen = marks(2, 0.2)
    assert seeker.add(seen[0]) is None
    assert seeker.reason == "3 more sightings of tags of known place are needed"
    for mark in seen[1:4]:
        assert seeker.add(mark) is None
    assert "the place is known to" in seeker.reason
    number, _ = found_after(seeker, seen[4:])
    assert number > 1


def test_contradictions_are_told() -> None:
    seeker = Seeker(SeekSettings(least=5))
    dice = np.random.default_rng(3)
    for mark in marks(3, 0.05)[:8]:
        wild = Landmark(mark.common, dice.normal(0.0, 9.0, 3), mark.covariance)
        assert seeker.add(wild) is None
    assert "agree" in seeker.reason


def test_a_few_wrong_tags_at_first_do_not_mislead_it() -> None:
    seeker = Seeker(SeekSettings(least=12))
    _, found = found_after(seeker, marks(4, 0.05, wrong=4))
    assert found.agreeing[:4] == (False,) * 4
    assert np.linalg.norm(registration_error(found)[:3]) < 0.15


def test_starting_over_forgets() -> None:
    seeker = Seeker(SeekSettings(least=3))
    seen = marks(5, 0.01)
    found_after(seeker, seen)
    seeker.start_over("it has jumped")
    assert seeker.reason == "it has jumped"
    assert seeker.add(seen[0]) is None


@pytest.mark.parametrize(
    "wrong", [{"least": 2}, {"least": 9, "most": 8}, {"sure_m": 0.0}, {"lost_after": 0}]
)
def test_numbers_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"must be|takes 3 to 200"):
        SeekSettings(**wrong)  # type: ignore[arg-type]


def test_the_spread_of_a_place_grows_with_its_distance() -> None:
    """Against chance: places carried through alignments drawn from the covariance."""
    _, found = found_after(Seeker(SeekSettings(least=10)), marks(6, 0.05))
    far = np.array([20.0, -10.0, 1.0])
    dice = np.random.default_rng(7)
    drawn = dice.multivariate_normal(np.zeros(4), found.covariance, 20_000)
    psi = found.alignment.yaw_rad + drawn[:, 3]
    x = np.cos(psi) * far[0] - np.sin(psi) * far[1] + drawn[:, 0]
    y = np.sin(psi) * far[0] + np.cos(psi) * far[1] + drawn[:, 1]
    expected = np.sqrt(x.var() + y.var() + drawn[:, 2].var())
    assert found.spread_m(far) == pytest.approx(expected, rel=0.03)
    assert found.spread_m(far) > 2.0 * found.spread_m(np.zeros(3))


def test_the_drift_filter_is_as_sure_as_it_may_be() -> None:
    """NEES over 60 frames that wander for 20 s while a tag is seen each second."""
    drift, noise_m, nees = Drift(shift_m=0.05, turn_rad=0.01), 0.05, []
    for run in range(60):
        dice = np.random.default_rng(run)
        _, found = found_after(Seeker(SeekSettings(least=15)), marks(1000 + run, noise_m))
        tracked = DriftFilter(found, drift)
        state = np.array([*TRUE.shift, TRUE.yaw_rad])
        walk = np.array([drift.shift_m] * 3 + [drift.turn_rad])
        for second in range(20):
            state = state + walk * dice.normal(size=4)
            tracked.wait(1.0)
            common = TAGS[second % len(TAGS)]
            c, s = np.cos(state[3]), np.sin(state[3])
            away = common - state[:3]
            seen = np.array([c * away[0] + s * away[1], c * away[1] - s * away[0], away[2]])
            seen += noise_m * dice.normal(size=3)
            tracked.sight(Landmark(common, seen, noise_m**2 * np.eye(3)))
        east, north, up = tracked.alignment.shift
        e = np.array([east, north, up, tracked.alignment.yaw_rad]) - state
        e[3] = np.remainder(e[3] + np.pi, 2.0 * np.pi) - np.pi
        nees.append(e @ np.linalg.solve(tracked.covariance, e))
    low, high = chi2.ppf([0.001, 0.999], 60 * 4) / 60
    assert low < np.mean(nees) < high


def test_the_drift_filter_leaves_out_what_cannot_be() -> None:
    _, found = found_after(Seeker(SeekSettings(least=15)), marks(8, 0.05))
    tracked = DriftFilter(found, Drift())
    mark = marks(9, 0.05)[0]
    wild = Landmark(mark.common, mark.odometry + 1.0, mark.covariance)
    assert not tracked.sight(wild)
    assert tracked.alignment.shift == pytest.approx(found.alignment.shift)
    assert tracked.sight(mark)
    assert np.trace(tracked.covariance) < np.trace(found.covariance)
