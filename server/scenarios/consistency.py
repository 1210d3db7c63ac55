"""Rules between the fields of a scenario: each field is fine by itself, do they fit together?"""

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import combinations, pairwise
from math import dist
from typing import TYPE_CHECKING

from server.mission.setup import Compat
from server.scenarios.errors import MAX_PROBLEMS, Problem, closest
from server.scenarios.parts import CircleMotion, ReplayMotion, TargetPart
from solver.problem import Dynamics

if TYPE_CHECKING:
    from server.scenarios.schema import Scenario


def problems(scenario: "Scenario") -> tuple[Problem, ...]:
    """Return everything that does not fit together, in the order of the file."""
    rules = (
        _ids,
        _field,
        _robots,
        _separation,
        _look_ahead,
        _targets,
        _weights,
        _pairs,
        _capacities,
    )
    return tuple(problem for rule in rules for problem in rule(scenario))


def _ids(scenario: "Scenario") -> Iterator[Problem]:
    lists: tuple[tuple[str, list[int | str]], ...] = (
        ("robots", [robot.id for robot in scenario.robots]),
        ("targets", [target.id for target in scenario.targets]),
        ("zones", [zone.id for zone in scenario.zones]),
    )
    for name, ids in lists:
        for repeated in (one for one, count in Counter(ids).items() if count > 1):
            last = len(ids) - 1 - ids[::-1].index(repeated)
            yield Problem(f"{name}[{last}].id", f"{repeated} is taken already; ids are unique")


def _field(scenario: "Scenario") -> Iterator[Problem]:
    lower, upper = scenario.field.lower, scenario.field.upper
    for axis in (0, 1):
        if not lower[axis] < upper[axis]:
            yield Problem(f"field.upper[{axis}]", f"must be above the lower bound {lower[axis]:g}")


def _robots(scenario: "Scenario") -> Iterator[Problem]:
    field = scenario.field
    for i, robot in enumerate(scenario.robots):
        for axis in (0, 1):
            low, value, high = field.lower[axis], robot.position[axis], field.upper[axis]
            if not low <= value <= high:
                yield Problem(
                    f"robots[{i}].position[{axis}]",
                    f"lies outside the field (allowed: {low:g} to {high:g}), got {value:g}",
                )
            if not robot.control_lower[axis] <= 0.0 <= robot.control_upper[axis]:
                yield Problem(
                    f"robots[{i}].control_lower[{axis}]",
                    "the control box must contain 0, or the robot cannot stop",
                )
            if not robot.control_lower[axis] < robot.control_upper[axis]:
                yield Problem(
                    f"robots[{i}].control_upper[{axis}]",
                    f"must be above the lower bound {robot.control_lower[axis]:g}",
                )
        if scenario.dynamics is Dynamics.DOUBLE_INTEGRATOR and robot.speed_limit_m_s is None:
            yield Problem(f"robots[{i}].speed_limit_m_s", "is needed for a double integrator")


def _separation(scenario: "Scenario") -> Iterator[Problem]:
    if scenario.compat is Compat.AUTHORS:
        return  # their files start robots closer than their own least distance
    least = scenario.planner.min_dist_m
    for (i, a), (j, b) in combinations(enumerate(scenario.robots), 2):
        if (apart := dist(a.position, b.position)) < least:
            yield Problem(
                f"robots[{j}].position",
                f"is {apart:.2f} m from robots[{i}]; planner.min_dist_m is {least:g} m",
            )


def _look_ahead(scenario: "Scenario") -> Iterator[Problem]:
    step_s, tick_s = scenario.planner.plan_step_s, scenario.tick_s
    if step_s < tick_s:
        yield Problem(
            "planner.plan_step_s",
            f"must be at least tick_s, {tick_s:g} s: until the next plan robots are only kept "
            f"apart for one such step, got {step_s:g}",
        )


def _targets(scenario: "Scenario") -> Iterator[Problem]:
    for j, target in enumerate(scenario.targets):
        yield from (
            Problem(f"targets[{j}].{path}", text) for path, text in _motion_problems(target)
        )


def _motion_problems(target: TargetPart) -> Iterator[tuple[str, str]]:
    motion = target.motion
    if isinstance(motion, CircleMotion) and motion.centre == target.position:
        yield "motion.centre", "is where the target starts; a circle needs a radius above 0"
    if isinstance(motion, ReplayMotion):
        times, positions = len(motion.times_s), len(motion.positions)
        if times != positions:
            yield "motion.positions", f"has {positions} entries for {times} times"
        if any(after <= before for before, after in pairwise(motion.times_s)):
            yield "motion.times_s", "must increase"


def _weights(scenario: "Scenario") -> Iterator[Problem]:
    weights = scenario.weights.weights()
    lower, upper = scenario.weight_range()
    for name, low, value, high in zip(weights._fields, lower, weights, upper, strict=True):
        if not low <= value <= high:
            yield Problem(
                f"weight_bounds.{name}",
                f"must contain the weight {value:g} itself, got {low:g} to {high:g}",
            )


def _pairs(scenario: "Scenario") -> Iterator[Problem]:
    hints = _Hints()
    robots = {robot.id for robot in scenario.robots}
    targets = {target.id for target in scenario.targets}
    for robot_id, row in scenario.assignment.items():
        if robot_id not in robots:
            hint = hints.near(robot_id, robots)
            yield Problem(f"assignment.{robot_id}", f"there is no such robot{hint}")
        known: set[int] = set()
        for k, target_id in enumerate(row):
            path = f"assignment.{robot_id}[{k}]"
            if target_id not in targets:
                hint = hints.near(target_id, targets)
                yield Problem(path, f"there is no target {target_id}{hint}")
            elif target_id in known:
                yield Problem(path, f"target {target_id} stands here already")
            known.add(target_id)


class _Hints:
    """Looks for the likeliest id, as often as somebody will read it: it takes its time."""

    def __init__(self) -> None:
        self._left = MAX_PROBLEMS

    def near(self, wanted: int, known: Iterable[int]) -> str:
        """Return `, did you mean "..."?` or nothing."""
        self._left -= 1
        return closest(str(wanted), map(str, sorted(known))) if self._left >= 0 else ""


def _capacities(scenario: "Scenario") -> Iterator[Problem]:
    """Refuse beta(A) > 0 (paper, eq. 4)."""
    wanted = len(scenario.targets)
    for i, robot in enumerate(scenario.robots):
        row = set(scenario.assignment.get(robot.id, ()))
        if len(row) > robot.capacity:
            yield Problem(
                f"assignment.{robot.id}",
                f"robot {robot.id} gets {len(row)} targets, but robots[{i}].capacity is "
                f"{robot.capacity} (allowed: {robot.capacity} or fewer)",
            )
    places = sum(min(robot.capacity, wanted) for robot in scenario.robots)
    if places == 0:
        yield Problem("robots", f"all capacities are 0, but there are {wanted} targets to track")
        return
    covered = {target for row in scenario.assignment.values() for target in row}
    missing = [target.id for target in scenario.targets if target.id not in covered]
    if len(missing) > max(0, wanted - places):
        names = ", ".join(map(str, missing))
        yield Problem(
            "assignment",
            f"leaves {len(missing)} of {wanted} targets to nobody ({names}), though the "
            f"team's capacities add up to {places}",
        )
