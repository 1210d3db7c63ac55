"""The world: attacks, recovery, sensing, motion, counters; and the same dice for everybody."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver.observations import Detections, Sighting
from solver.problem import Dynamics
from solver.streams import Streams
from solver.zones import ZoneKind
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles.world.motion import Circle, RandomWalk
from vehicles.world.setup import Discovery, NoiseLaw, WorldSetup, WorldTarget, WorldZone
from vehicles.world.state import Cause, Failures, Hit, Recovery, WorldEvent
from vehicles.world.world import World

TARGET = WorldTarget(122, (3.0, 4.0), (0.1, 0.0))


def certain(kind: ZoneKind) -> WorldZone:
    """A zone so dense in its centre that it always hits there."""
    return zone("z1", kind, covariance=((0.1, 0.0), (0.0, 0.1)), margin=0.0)


def make(setup: WorldSetup, seed: int = 0) -> World:
    return World(setup, Streams(seed))


# ---------------------------------------------------------------------- attacks


def test_standing_in_a_zone_is_hit_as_often_as_its_density_says() -> None:
    setup = world_setup(
        (robot(21, 0.0),), zones=(zone("s1", ZoneKind.SENSING),), attack_period_s=0.5
    )
    world = make(setup)
    steps = 4000
    for _ in range(steps):
        world.attack(0.5)
        world.move(0.5, {})
    chance = 1.0 / (2.0 * np.pi)
    deviation = np.sqrt(chance * (1.0 - chance) / steps)
    assert world.hits(ZoneKind.SENSING) / steps == pytest.approx(chance, abs=4.0 * deviation)
    assert world.hits(ZoneKind.COMMUNICATION) == 0


def test_a_hit_fails_the_robot_reveals_the_zone_and_counts_again_while_failing() -> None:
    world = make(world_setup((robot(21, 0.0),), (TARGET,), (certain(ZoneKind.SENSING),)))
    first = world.attack(0.5)
    assert first == (Hit(21, ZoneKind.SENSING, world.setup.zones[0].zone, Cause.DICE, 0.0),)
    assert world.failures(21) == Failures(sensing=True)
    assert world.robot_state(21).sensing_failed
    assert world.sense(21, [122]) is None
    world.move(0.5, {})
    world.attack(0.5)
    assert world.hits(ZoneKind.SENSING) == 2


def test_two_zones_hit_twice_in_one_step() -> None:
    zones = (certain(ZoneKind.SENSING), replace(certain(ZoneKind.SENSING)))
    zones = (zones[0], replace(zones[1], zone=replace(zones[1].zone, id="z2")))
    world = make(world_setup((robot(21, 0.0),), zones=zones))
    assert len(world.attack(0.5)) == 2
    assert world.hits(ZoneKind.SENSING) == 2


def test_inferred_discovery_reveals_nothing() -> None:
    setup = world_setup((robot(21, 0.0),), zones=(certain(ZoneKind.SENSING),))
    (hit,) = make(replace(setup, discovery=Discovery.INFERRED)).attack(0.5)
    assert isinstance(hit, Hit)
    assert hit.zone is None


def test_a_communication_failure_leaves_sensing_alone() -> None:
    world = make(world_setup((robot(21, 0.0),), (TARGET,), (certain(ZoneKind.COMMUNICATION),)))
    world.attack(0.5)
    assert world.failures(21) == Failures(communication=True)
    assert world.sense(21, [122]) is not None


def test_the_spread_of_the_team_jams_for_certain() -> None:
    jammer = zone("c1", ZoneKind.COMMUNICATION, covariance=((1e-4, 0.0), (0.0, 1e-4)), margin=0.2)
    world = make(world_setup((robot(1, 1.0), robot(2, 7.0)), zones=(jammer,)))
    (hit,) = world.attack(0.5)
    assert isinstance(hit, Hit)
    assert (hit.robot_id, hit.cause) == (1, Cause.SPREAD)
    assert world.hits(ZoneKind.COMMUNICATION) == 1


# ---------------------------------------------------------------------- recovery


def fly_out(world: World, steps: int) -> list[WorldEvent]:
    events: list[WorldEvent] = []
    for _ in range(steps):
        world.move(0.5, {21: (1.0, 0.0)})
        events.extend(world.attack(0.5))
    return events


def test_a_robot_recovers_outside_and_not_before() -> None:
    world = make(world_setup((robot(21, 0.0),), zones=(certain(ZoneKind.SENSING),)))
    world.attack(0.5)
    events = fly_out(world, 6)
    recoveries = [event for event in events if isinstance(event, Recovery)]
    assert len(recoveries) == 1
    centre = world.setup.zones[0].zone
    limit = world.setup.recover_density
    step = round(recoveries[0].time_s / 0.5)
    assert centre.density(np.array([0.5 * step, 0.0])) < limit
    assert centre.density(np.array([0.5 * (step - 1), 0.0])) >= limit
    assert world.failures(21) == Failures()


def test_outside_of_one_zone_but_inside_another_does_not_recover() -> None:
    wide = zone("s2", ZoneKind.SENSING, (0.0, 0.0), ((9.0, 0.0), (0.0, 9.0)))
    for zones, recovers in (((certain(ZoneKind.SENSING),), True), ((wide,), False)):
        world = make(world_setup((robot(21, 2.0),), zones=zones, recover_density=1e-3))
        world.attack(1e12)
        assert world.failures(21).sensing
        world.move(0.5, {})
        world.attack(1e-12)
        assert world.failures(21).sensing is not recovers


def test_a_zone_of_the_other_kind_does_not_keep_a_failure() -> None:
    blinding = certain(ZoneKind.SENSING)
    jamming = zone("c1", ZoneKind.COMMUNICATION, (3.0, 0.0), ((0.2, 0.0), (0.0, 0.2)), margin=0.0)
    world = make(world_setup((robot(21, 0.0),), zones=(blinding, jamming)))
    world.attack(0.5)
    fly_out(world, 6)
    assert world.failures(21) == Failures(communication=True)


# ---------------------------------------------------------------------- the same dice


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32), data=st.data())
def test_two_policies_meet_the_same_dice(seed: int, data: st.DataObject) -> None:
    """A robot and its sensor do not notice what anybody else did before."""
    zones = (zone("s1", ZoneKind.SENSING), zone("c1", ZoneKind.COMMUNICATION, margin=0.0))
    setup = world_setup((robot(1, 0.0), robot(2, 9.0)), (TARGET,), zones)
    calm, busy = make(setup, seed), make(setup, seed)
    for _ in range(5):
        away = data.draw(st.floats(-1.0, 1.0))
        busy.sense(2, [122])
        calm_events = [event for event in calm.attack(0.5) if event.robot_id == 1]
        busy_events = [event for event in busy.attack(0.5) if event.robot_id == 1]
        assert calm_events == busy_events
        assert calm.sense(1, [122]) == busy.sense(1, [122])
        calm.move(0.5, {})
        busy.move(0.5, {2: (away, away)})


def test_another_seed_is_another_world() -> None:
    setup = world_setup((robot(1, 0.0),), (TARGET,))
    assert make(setup, 1).sense(1, [122]) != make(setup, 2).sense(1, [122])


def test_noise_differs_between_steps_robots_and_targets() -> None:
    twin = replace(TARGET, id=124)
    world = make(world_setup((robot(1, 0.0), robot(2, 0.0)), (TARGET, twin)))
    seen = {sighting.range_m for sighting in _sightings(world.sense(1, [122, 124]))}
    seen |= {sighting.range_m for sighting in _sightings(world.sense(2, [122, 124]))}
    assert len(seen) == 4


def _sightings(detections: Detections | None) -> tuple[Sighting, ...]:
    assert detections is not None
    return detections.sightings


# ---------------------------------------------------------------------- sensing


def test_measurements_scatter_around_the_truth_as_the_model_says() -> None:
    still = WorldTarget(122, (3.0, 4.0))
    world = make(world_setup((robot(1, 0.0),), (still,)))
    ranges, bearings = [], []
    for _ in range(3000):
        detections = world.sense(1, [122])
        assert detections is not None
        ranges.append(detections.sightings[0].range_m)
        bearings.append(detections.sightings[0].bearing_rad)
        world.move(0.1, {})
    deviation = np.sqrt(np.exp(0.2 * 5.0) / 15.0)
    assert np.mean(ranges) == pytest.approx(5.0, abs=4 * deviation / np.sqrt(3000))
    assert np.std(ranges) == pytest.approx(deviation, rel=0.06)
    assert np.mean(bearings) == pytest.approx(np.arctan2(4, 3), abs=4 * deviation / np.sqrt(3000))
    assert np.std(bearings) == pytest.approx(deviation, rel=0.06)


def test_the_authors_noise_is_smaller_near_by() -> None:
    setup = replace(world_setup((robot(1, 0.0),), (TARGET,)), noise=NoiseLaw.AUTHORS)
    seen = make(setup).sense(1, [122])
    sound = make(replace(setup, noise=NoiseLaw.SOUND)).sense(1, [122])
    assert seen is not None
    assert sound is not None
    assert abs(seen.sightings[0].range_m - 5.0) < abs(sound.sightings[0].range_m - 5.0)


def test_only_what_was_asked_for_and_is_in_reach_is_seen() -> None:
    far = WorldTarget(124, (30.0, 0.0))
    setup = world_setup((robot(1, 0.0),), (TARGET, far))
    asked = make(setup).sense(1, [124, 999])
    assert asked is not None
    assert [sighting.target_id for sighting in asked.sightings] == [124]
    near = make(replace(setup, detection_range_m=10.0)).sense(1, [122, 124])
    assert near is not None
    assert [sighting.target_id for sighting in near.sightings] == [122]


# ---------------------------------------------------------------------- motion


def test_robots_fly_what_they_are_told_within_their_box() -> None:
    world = make(world_setup((robot(1, 0.0), robot(2, 5.0))))
    world.move(0.5, {1: (0.4, 9.0)})
    assert world.robot_state(1).position == pytest.approx((0.2, 0.5))
    assert world.robot_state(1).velocity == (0.4, 1.0)
    assert world.robot_state(2).position == (5.0, 0.0)
    assert world.robot_state(2).velocity == (0.0, 0.0)


def test_a_double_integrator_needs_time_to_turn() -> None:
    slow = replace(robot(1, 0.0), dynamics=Dynamics.DOUBLE_INTEGRATOR)
    world = make(world_setup((slow,)))
    world.move(0.5, {1: (0.3, 0.0)})  # within reach: 0.6 m/s^2
    assert world.robot_state(1).velocity == pytest.approx((0.3, 0.0))
    assert world.robot_state(1).position == pytest.approx((0.075, 0.0))
    world.move(0.5, {1: (-9.0, 0.0)})  # clipped to -1 m/s^2
    assert world.robot_state(1).velocity == pytest.approx((-0.2, 0.0))
    assert world.robot_state(1).position == pytest.approx((0.1, 0.0))


def test_robots_climb_and_sink_at_their_own_rate() -> None:
    world = make(world_setup((robot(1, 0.0), robot(2, 5.0))))
    assert world.robot_state(1).altitude_m == 1.5
    world.move(1.0, {}, {1: 0.0})
    assert world.robot_state(1).altitude_m == pytest.approx(1.0)
    assert world.robot_state(2).altitude_m == 2.0
    world.move(4.0, {}, {1: 0.0, 2: 2.3})
    assert world.robot_state(1).altitude_m == 0.0
    assert [robot.altitude_m for robot in world.truth().robots] == pytest.approx([0.0, 2.3])
    assert world.path_length_m(1) == 0.0


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_nonsense_commands_are_refused_and_nothing_moves(bad: float) -> None:
    world = make(world_setup((robot(1, 0.0),)))
    with pytest.raises(ValueError, match="not finite"):
        world.move(0.5, {1: (bad, 0.0)})
    with pytest.raises(ValueError, match="not finite"):
        world.move(0.5, {}, {1: bad})
    with pytest.raises(KeyError):
        world.move(0.5, {7: (0.0, 0.0)})
    with pytest.raises(ValueError, match="dt_s"):
        world.move(0.0, {})
    assert world.truth() == make(world_setup((robot(1, 0.0),))).truth()


def test_targets_and_zones_move_on_and_the_truth_tells() -> None:
    circling = WorldTarget(124, (1.0, 0.0), motion=Circle((0.0, 0.0), np.pi))
    wandering = WorldTarget(126, (0.0, 0.0), motion=RandomWalk(0.5))
    drifting = WorldZone(
        zone("s1", ZoneKind.SENSING, (50.0, 0.0)).zone, velocity=(0.0, 1.0), growth_m2_s=0.2
    )
    world = make(world_setup((robot(1, 0.0),), (TARGET, circling, wandering), (drifting,)))
    for _ in range(10):
        world.move(0.1, {})
    truth = world.truth()
    assert truth.time_s == pytest.approx(1.0)
    assert truth.step == 10
    places = {target.id: target for target in truth.targets}
    assert places[122].position == pytest.approx((3.1, 4.0))
    assert places[122].velocity == (0.1, 0.0)
    assert places[124].position == pytest.approx((-1.0, 0.0))
    assert np.hypot(*places[124].velocity) == pytest.approx(np.pi, rel=0.01)
    assert places[126].position != (0.0, 0.0)
    assert truth.zones[0].mean == pytest.approx((50.0, 1.0))
    assert np.array(truth.zones[0].covariance) == pytest.approx(np.diag([1.2, 1.2]))


# ---------------------------------------------------------------------- counters


def test_every_move_counts_for_the_path_and_every_pair_for_the_separation() -> None:
    world = make(world_setup((robot(1, 0.0), robot(2, 3.0), robot(3, 9.0))))
    assert world.min_separation_m == pytest.approx(3.0)
    world.move(1.0, {1: (1.0, 0.0), 2: (-0.5, 0.0)})
    world.move(1.0, {1: (-1.0, 0.0)})
    assert world.path_length_m(1) == pytest.approx(2.0)
    assert world.path_length_m(2) == pytest.approx(0.5)
    assert world.path_length_m(3) == 0.0
    assert world.min_separation_m == pytest.approx(1.5)
    assert make(world_setup((robot(1, 0.0),))).min_separation_m is None
