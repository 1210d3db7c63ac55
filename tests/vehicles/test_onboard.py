"""Flying alone: what is taken along, what is planned, what is brought back."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.stats import norm

from solver import engines
from solver.beliefs import FilterSettings, MotionModel
from solver.exposure import RIMS, Prices, zone_table
from solver.observations import Detections, OnboardTrack, Sighting
from solver.planner import Planner
from solver.problem import Budget
from solver.zones import Zone, ZoneKind
from tests.solver.measuring import predicted
from tests.vehicles.pilots import (
    INFERENCE,
    JAMMING,
    RULES,
    SENSING,
    Recorder,
    knowledge,
    track,
    with_rules,
)
from vehicles.onboard import BACK_OFF_M_S, BACK_OFF_MOST_M, OnboardPilot

BUDGET = Budget()
HERE, STILL = (0.0, 0.0), (0.0, 0.0)


def cut_off(at_s: float = 10.0) -> tuple[OnboardPilot, Recorder]:
    planner = Recorder()
    pilot = OnboardPilot(21, planner)
    pilot.learn(knowledge())
    pilot.lost_link(at_s)
    return pilot, planner


def seen(target_id: int, range_m: float, bearing_rad: float) -> Detections:
    return Detections(21, HERE, (Sighting(target_id, range_m, bearing_rad),))


def test_connected_or_never_told_it_stands_still() -> None:
    planner = Recorder()
    pilot = OnboardPilot(21, planner)
    pilot.lost_link(0.0)
    assert not pilot.alone
    assert pilot.plan(1.0, (2.0, 3.0), STILL, BUDGET) == ((0.0, 0.0), (2.0, 3.0))
    pilot.learn(knowledge())
    assert pilot.plan(1.0, (2.0, 3.0), STILL, BUDGET) == ((0.0, 0.0), (2.0, 3.0))
    assert planner.problems == []


def test_anothers_knowledge_is_refused() -> None:
    with pytest.raises(ValueError, match="robot 21 was told what robot 26"):
        OnboardPilot(21, Recorder()).learn(knowledge(robot_id=26))


def test_alone_it_solves_the_problem_of_one_robot() -> None:
    pilot, planner = cut_off()
    pilot.observe(Detections(21, HERE, ()))
    velocity, waypoint = pilot.plan(10.5, (0.5, -0.5), (0.1, 0.2), BUDGET)
    assert velocity == (0.1, 0.0)
    assert waypoint == pytest.approx((0.55, -0.5))
    (problem,) = planner.problems
    assert problem.robot_ids == (21,)
    assert problem.positions.tolist() == [[0.5, -0.5]]
    assert problem.velocities.tolist() == [[0.1, 0.2]]
    assert problem.sees.tolist() == [[True, True]]
    assert problem.obstacles.tolist() == [[3.0, 3.0]]
    assert problem.weights == knowledge().weights
    assert problem.speed_limit.tolist() == [0.5]
    assert problem.previous is None


def test_zones_are_feared_as_one_robot_fears_them() -> None:
    pilot, planner = cut_off()
    pilot.plan(10.0, HERE, STILL, BUDGET)
    (problem,) = planner.problems
    assert problem.sensing.centres.tolist() == [[4.0, 0.0]]
    assert problem.sensing.margins.tolist() == [0.1]
    assert problem.sensing.quantiles == pytest.approx([norm.isf(0.1)])
    assert problem.communication.centres.tolist() == [[0.0, 4.0]]
    assert problem.communication.margins.tolist() == [0.0], "no team term alone"
    assert problem.communication.quantiles == pytest.approx([norm.isf(0.3) * np.sqrt(2.0)])
    assert problem.communication.severities.tolist() == [2.0]
    assert problem.sensing.known.tolist() == [[True]]


def test_alone_it_pays_for_exposure_as_the_team_does() -> None:
    planner = Recorder()
    pilot = OnboardPilot(21, planner)
    pilot.learn(replace(knowledge(), prices=Prices(sensing=2.0, communication=3.0)))
    pilot.lost_link(10.0)
    pilot.plan(10.0, HERE, STILL, BUDGET)
    (problem,) = planner.problems
    one = np.ones((1, 1), dtype=bool)
    sensing = zone_table([SENSING], one, [SENSING.quantile()], [0.1], [1.0], 2.0)
    alone = JAMMING.quantile_single(2.0)
    communication = zone_table([JAMMING], one, [alone], [0.0], [2.0], 3.0)
    for found, expected in ((problem.sensing, sensing), (problem.communication, communication)):
        assert len(found.margins) == 1 + len(RIMS)
        for name in ("centres", "covariances", "margins", "quantiles", "severities", "known"):
            assert np.array_equal(getattr(found, name), getattr(expected, name))


def test_the_longer_it_is_cut_off_the_farther_it_backs_off() -> None:
    pilot, planner = cut_off()
    for now_s in (10.0, 15.0, 1000.0, 2000.0):
        pilot.plan(now_s, HERE, STILL, BUDGET)
    deviation_m = np.sqrt(0.6)
    told = [float(problem.communication.quantiles[0]) * deviation_m for problem in planner.problems]
    assert told[1] - told[0] == pytest.approx(5.0 * BACK_OFF_M_S)
    assert told[2] - told[0] == pytest.approx(BACK_OFF_MOST_M)
    assert told[3] == told[2]
    assert [problem.sensing.margins.tolist() for problem in planner.problems] == [[0.1]] * 4


def test_a_zone_suffered_alone_counts_at_once_and_is_brought_back() -> None:
    pilot, planner = cut_off()
    new = Zone("c9", ZoneKind.COMMUNICATION, (7.0, 7.0), ((1.0, 0.0), (0.0, 1.0)), 0.2, 0.05)
    pilot.reveal(new)
    pilot.plan(10.5, HERE, STILL, BUDGET)
    assert planner.problems[0].communication.centres.tolist() == [[0.0, 4.0], [7.0, 7.0]]
    assert pilot.report(10.5).zones == (new,), "what it was told may have changed meanwhile"
    moved = replace(SENSING, mean=(5.0, 5.0))
    pilot.reveal(moved)
    assert pilot.zones == (moved, JAMMING, new)
    assert pilot.report(10.5).zones == (new, moved)


def test_a_zone_suffered_just_before_is_not_forgotten_until_the_team_tells_it() -> None:
    pilot = OnboardPilot(21, Recorder())
    pilot.learn(replace(knowledge(), zones=()))
    pilot.reveal(SENSING)
    pilot.learn(replace(knowledge(), zones=()))
    assert pilot.zones == (SENSING,)
    pilot.learn(replace(knowledge(), zones=(replace(SENSING, mean=(1.0, 1.0)),)))
    assert pilot.zones[0].mean == (1.0, 1.0)


def test_the_private_filter_is_a_kalman_filter_started_from_the_teams_tracks() -> None:
    pilot, planner = cut_off(at_s=10.5)
    pilot.observe(seen(122, 1.2, 0.1))
    pilot.plan(10.5, HERE, STILL, BUDGET)

    oracle = ExtendedKalmanFilter(dim_x=2, dim_z=2)
    oracle.x, oracle.P = np.array([1.0, 0.0]), 0.2 * np.eye(2)
    oracle.Q = RULES.filter.process_noise * 0.5 * np.eye(2)
    oracle.predict()
    rho = np.sqrt(1.0 + 0.1**2)
    oracle.R = np.eye(2) * np.exp(0.2 * rho) / 15.0
    oracle.update(
        np.array([1.2, 0.1]),
        HJacobian=lambda _: np.array([[1.0 / rho, 0.0], [0.0, 1.0 / rho**2]]),
        Hx=lambda x: np.array([np.hypot(*x), np.arctan2(x[1], x[0])]),
    )
    tracks = {found.target_id: found for found in pilot.report(10.5).tracks}
    # The textbook filter is the oracle as far as it holds: so near it is off by centimetres.
    assert tracks[122].mean == pytest.approx(oracle.x, abs=0.02)
    assert np.array(tracks[122].covariance) == pytest.approx(oracle.P, abs=0.03)
    assert tracks[124].mean == (2.0, 2.0), "unseen targets are predicted"
    assert np.array(tracks[124].covariance) == pytest.approx((0.2 + 0.05) * np.eye(2))
    assert planner.problems[0].target_means[0] == pytest.approx(
        np.array([tracks[122].mean, tracks[124].mean])
    )


def test_it_predicts_by_the_time_that_passed_and_not_twice() -> None:
    pilot, _ = cut_off()
    for now in (10.1, 10.4, 10.4, 11.0):
        pilot.plan(now, HERE, STILL, BUDGET)
    for now, passed in ((11.0, 1.0), (10.0, 1.0), (13.0, 3.0)):
        (first, _) = pilot.report(now).tracks
        expected = 0.2 + passed * RULES.filter.process_noise
        assert first.covariance[0][0] == pytest.approx(expected)


def test_without_observations_it_is_blind() -> None:
    pilot, planner = cut_off()
    pilot.observe(seen(122, 1.0, 0.0))
    pilot.plan(10.5, HERE, STILL, BUDGET)
    pilot.plan(11.0, HERE, STILL, BUDGET)
    assert [problem.sees.any() for problem in planner.problems] == [True, False]


def test_a_target_unknown_to_the_team_is_planned_for_once_it_is_seen() -> None:
    planner = Recorder()
    pilot = OnboardPilot(21, planner)
    pilot.learn(replace(knowledge(), tracks=(track(122, 1.0, 0.0),)))
    pilot.lost_link(10.0)
    pilot.plan(10.5, HERE, STILL, BUDGET)
    pilot.observe(seen(124, 3.0, 0.0))
    pilot.plan(11.0, HERE, STILL, BUDGET)
    assert [problem.sees.shape for problem in planner.problems] == [(1, 1), (1, 2)]
    assert {found.target_id for found in pilot.report(11.0).tracks} == {122, 124}


@pytest.mark.parametrize(
    "damaged",
    [
        OnboardTrack(122, (1.0, 0.0, 0.0), ((1.0, 0.0), (0.0, 1.0))),
        OnboardTrack(122, (1.0, float("nan")), ((1.0, 0.0), (0.0, 1.0))),
        OnboardTrack(122, (1.0, 0.0), ((1.0, 2.0), (2.0, 1.0))),
        OnboardTrack(999, (1.0, 0.0), ((1.0, 0.0), (0.0, 1.0))),
    ],
)
def test_a_damaged_track_counts_as_unknown(damaged: OnboardTrack) -> None:
    pilot = OnboardPilot(21, Recorder())
    pilot.learn(replace(knowledge(), tracks=(damaged,)))
    pilot.lost_link(10.0)
    assert pilot.alone
    assert pilot.report(10.0).tracks == ()


def test_velocities_are_handed_over_too() -> None:
    settings = FilterSettings(model=MotionModel.CONSTANT_VELOCITY, process_noise=0.01)
    moving = OnboardTrack(
        122, (1.0, 0.0, 0.4, 0.0), tuple(tuple(row) for row in np.diag([0.2] * 4).tolist())
    )
    planner = Recorder()
    pilot = OnboardPilot(21, planner)
    pilot.learn(with_rules(replace(knowledge(), tracks=(moving,)), filter=settings))
    pilot.lost_link(10.0)
    pilot.plan(12.0, HERE, STILL, BUDGET)
    assert planner.problems[0].target_means[0, 0] == pytest.approx([1.8 + 0.2, 0.0])


def test_the_plan_is_kept_as_a_warm_start_shifted_by_the_time_that_passed() -> None:
    planner = Recorder()
    pilot = OnboardPilot(21, planner)
    pilot.learn(with_rules(knowledge(), horizon=3))
    pilot.lost_link(10.0)
    pilot.plan(10.0, HERE, STILL, BUDGET)
    pilot.plan(10.1, HERE, STILL, BUDGET)
    pilot.plan(10.6, HERE, STILL, BUDGET)
    previous = [problem.previous for problem in planner.problems]
    assert previous[0] is None
    assert previous[1] is not None
    assert previous[2] is not None
    assert previous[1][0, :, 1] == pytest.approx([0.2, 1.2, 2.0])
    assert previous[2][0, :, 1] == pytest.approx([1.0, 2.0, 2.0])


def test_coming_back_ends_being_alone() -> None:
    pilot, _ = cut_off()
    assert len(pilot.report(12.0).tracks) == 2
    pilot.learn(knowledge(time_s=12.0))
    assert not pilot.alone
    assert pilot.report(12.0).tracks == ()


# ---------------------------------------------------------------------- zones nobody reveals


def silenced(planner: Recorder, **rules: object) -> OnboardPilot:
    """A pilot that was heard on its way east and is heard no more at the origin."""
    pilot = OnboardPilot(21, planner)
    pilot.learn(with_rules(replace(knowledge(), zones=()), **rules))
    for step in range(-20, 1):
        pilot.note(10.0 + 0.2 * step, (0.1 * step, 0.0), heard=step < 0)
    pilot.lost_link(10.0)
    return pilot


def test_what_cut_it_off_is_inferred_where_nothing_reveals_it() -> None:
    planner = Recorder()
    pilot = silenced(planner, inference=INFERENCE)
    pilot.plan(10.2, HERE, STILL, BUDGET)
    (centre,) = planner.problems[-1].communication.centres
    assert 0.0 < centre[0] < 2.0
    report = pilot.report(10.4)
    assert report.zones == (), "what it has inferred is its own"
    assert report.silent == ((0.0, 0.0),), "the team draws its own conclusions"
    pilot.note(12.0, (-0.5, 0.0), heard=True)
    pilot.learn(with_rules(replace(knowledge(), zones=()), inference=INFERENCE))
    assert pilot.zones == ()


def test_what_it_has_learnt_is_not_forgotten_when_it_is_told_again() -> None:
    planner = Recorder()
    pilot = silenced(planner, inference=INFERENCE)
    pilot.plan(10.2, HERE, STILL, BUDGET)
    pilot.note(12.0, (-0.5, 0.0), heard=True)
    pilot.learn(with_rules(replace(knowledge(), zones=()), inference=INFERENCE))
    pilot.lost_link(12.2)
    pilot.plan(12.4, (-0.5, 0.0), STILL, BUDGET)
    assert len(planner.problems[-1].communication.centres) == 1


def test_another_mission_has_zones_of_its_own() -> None:
    planner = Recorder()
    pilot = silenced(planner, inference=INFERENCE)
    pilot.plan(10.2, HERE, STILL, BUDGET)
    other = with_rules(replace(knowledge(), mission="m2", zones=()), inference=INFERENCE)
    pilot.learn(other)
    pilot.note(12.0, (-0.5, 0.0), heard=True)
    pilot.lost_link(12.2)
    pilot.plan(12.4, (-0.5, 0.0), STILL, BUDGET)
    assert planner.problems[-1].communication.centres.shape == (0, 2)


def test_nothing_is_inferred_where_zones_reveal_themselves() -> None:
    planner = Recorder()
    pilot = silenced(planner)
    pilot.plan(10.2, HERE, STILL, BUDGET)
    assert planner.problems[-1].communication.centres.shape == (0, 2)
    assert pilot.report(10.4).silent == ()


# ---------------------------------------------------------------------- with a real optimizer


def flown_alone(zones: tuple[Zone, ...], steps: int) -> list[tuple[float, float]]:
    """Fly alone towards target 122 from the west, seeing it exactly; return the way."""
    pilot = OnboardPilot(21, Planner(engines.create("sqp")))
    known = replace(knowledge(), targets=(122,), tracks=(track(122, 3.0, 0.0),), zones=zones)
    pilot.learn(with_rules(known, horizon=3))
    pilot.lost_link(10.0)
    position, velocity = (-3.0, 0.2), (0.0, 0.0)
    way = [position]
    for step in range(steps):
        distance, bearing = predicted(position, (3.0, 0.0))
        seeing = Detections(21, position, (Sighting(122, distance, bearing),))
        pilot.observe(seeing)
        velocity, waypoint = pilot.plan(10.5 + 0.5 * step, position, velocity, BUDGET)
        assert waypoint == pytest.approx(
            (position[0] + 0.5 * velocity[0], position[1] + 0.5 * velocity[1]), abs=1e-6
        )
        assert max(map(abs, velocity)) <= 0.5 + 1e-9
        position = waypoint
        way.append(position)
    return way


def test_alone_it_goes_to_its_target() -> None:
    way = flown_alone((), 40)
    assert np.hypot(way[-1][0] - 3.0, way[-1][1]) < 1.5


def test_alone_it_keeps_out_of_the_zones_it_knows() -> None:
    blind = Zone("s9", ZoneKind.SENSING, (0.0, 0.0), ((0.3, 0.0), (0.0, 0.3)), 0.1, 0.1)
    jam = replace(blind, id="c9", kind=ZoneKind.COMMUNICATION, margin=0.2, risk_single=0.1)
    free = min(np.hypot(*point) for point in flown_alone((), 40))
    for zone in (blind, jam):
        near = min(np.hypot(*point) for point in flown_alone((zone,), 40))
        assert near > free
        assert near > 0.5 * zone.quantile() * np.sqrt(0.3)


def test_alone_it_leaves_what_cut_it_off_though_nobody_told_it_of_a_zone() -> None:
    """Its target lies on in the zone; it goes back to where it was heard."""
    pilot = OnboardPilot(21, Planner(engines.create("sqp")))
    known = replace(knowledge(), targets=(122,), tracks=(track(122, 1.0, 0.0),), zones=())
    pilot.learn(with_rules(known, horizon=3, inference=INFERENCE))
    zone = Zone("c", ZoneKind.COMMUNICATION, (0.7, 0.0), ((0.3, 0.0), (0.0, 0.3)), 0.0, 0.02)
    for step in range(-20, 0):
        pilot.note(10.0 + 0.2 * step, (0.1 * step, 0.0), heard=True)
    pilot.lost_link(10.0)
    position, velocity, now_s = (0.0, 0.0), STILL, 10.0
    for _ in range(50):
        pilot.note(now_s, position, heard=False)
        pilot.observe(Detections(21, position, ()))
        velocity, _ = pilot.plan(now_s, position, velocity, BUDGET)
        position = (position[0] + 0.4 * velocity[0], position[1] + 0.4 * velocity[1])
        now_s += 0.2
        if float(zone.density(np.array(position))) < INFERENCE.law.recover_density:
            break
    else:
        raise AssertionError(f"it is still at {position}")
    assert position[0] < 0.7, "it went out by the way it came"
