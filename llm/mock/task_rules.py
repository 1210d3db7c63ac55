"""The mock's assignments: near targets, sound cover, few changes, what the human asked for."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from llm.mock.comment_rules import TASK_KINDS, Wish, WishKind, understand
from llm.mock.deciding import Reaction, TaskDecision
from llm.mock.reading import Reading, SeenComment, SeenRobot
from llm.mock.scoring import Cost, Plan, Scorer

CLEAR_GAIN = 0.08
"""Relative gain in the summed trace below which nothing is reassigned."""

NEAREST = 4
"""Robots tried per target."""

MOST_ROUNDS = 40

Pair = tuple[int, int]


@dataclass(slots=True)
class Bounds:
    """What an assignment must keep to, by pins and comments."""

    required: dict[Pair, str] = field(default_factory=dict)
    """Pair -> label of the comment that asked for it; empty for a pin."""

    forbidden: dict[Pair, str] = field(default_factory=dict)
    one_each: bool = False

    def allow(self, plan: Plan) -> bool:
        """Return whether a plan keeps to the pairs."""
        return all(t in plan.get(r, ()) for r, t in self.required) and not any(
            t in plan.get(r, ()) for r, t in self.forbidden
        )

    def follow(self, plan: Plan) -> None:
        """Give up what older comments asked for where a newer one has overruled them."""
        for pair in [p for p, label in self.required.items() if label]:
            if pair[1] not in plan.get(pair[0], ()):
                del self.required[pair]
        for pair in [p for p, label in self.forbidden.items() if label]:
            if pair[1] in plan.get(pair[0], ()):
                del self.forbidden[pair]


def decide(reading: Reading) -> TaskDecision:
    """Return an assignment for a task prompt."""
    bounds = Bounds(
        required={(p.robot, p.target): "" for p in reading.pins if not p.forbids},
        forbidden={(p.robot, p.target): "" for p in reading.pins if p.forbids},
    )
    current: Plan = {robot.id: frozenset(robot.row) for robot in reading.robots if not robot.lost}
    plan = _sound(reading, current, bounds)
    reactions: list[Reaction] = []
    capacities: tuple[tuple[int, int], ...] = ()
    asked_anew = False
    for comment in reading.comments:
        wish = understand(comment.text)
        if comment.verdict == "declined":
            continue
        if wish.kind is WishKind.CAPACITY:
            reading, capacities, reaction = _capacity(reading, comment, wish, capacities)
            plan = _sound(reading, plan, bounds)
        elif wish.kind in TASK_KINDS:
            plan, reaction = _grant(reading, plan, bounds, comment, wish)
        else:
            reaction = Reaction(comment.label, *_elsewhere(reading, wish))
        if comment.new:
            asked_anew = asked_anew or wish.kind in TASK_KINDS
            reactions.append(reaction)
    better = plan if asked_anew else _improved(reading, plan, bounds)
    rows = tuple(
        (robot.id, tuple(sorted(better[robot.id])))
        for robot in reading.robots
        if robot.free and robot.id in better
    )
    feedback = _feedback(reading, current, better)
    return TaskDecision(rows, feedback, tuple(reactions), capacities)


# ---------------------------------------------------------------------------- search


def _sound(reading: Reading, plan: Plan, bounds: Bounds) -> Plan:
    """Return the plan, or the nearest thing to it that covers what can be covered."""
    scorer = Scorer(reading, one_each=False)
    kept = _kept_to(reading, plan, bounds)
    best, cost = kept, scorer.cost(kept)
    for _ in range(MOST_ROUNDS):
        step = min(
            ((scorer.cost(next_plan), next_plan) for next_plan in _moves(reading, best, bounds)),
            key=lambda pair: pair[0],
            default=None,
        )
        if step is None or _duties(step[0]) >= _duties(cost):
            break
        cost, best = step
    return best


def _kept_to(reading: Reading, plan: Plan, bounds: Bounds) -> Plan:
    """Force the pairs and the capacities onto a plan; cover may be lost by it."""
    rows: dict[int, frozenset[int]] = {}
    for robot in reading.robots:
        if robot.lost:
            continue
        row = set(plan.get(robot.id, ()))
        if robot.free:
            must = {t for r, t in bounds.required if r == robot.id}
            row = (row | must) - {t for r, t in bounds.forbidden if r == robot.id}
            spare = sorted(row - must)
            while len(row) > robot.capacity and spare:
                row.discard(spare.pop())
        rows[robot.id] = frozenset(row)
    return rows


def _duties(cost: Cost) -> tuple[int, int, int]:
    return cost.overload, cost.uncovered, cost.unsighted


def _improved(reading: Reading, plan: Plan, bounds: Bounds) -> Plan:
    """Return a clearly better plan by steepest descent, or the plan itself."""
    scorer = Scorer(reading, bounds.one_each)
    start = scorer.cost(plan)
    best, cost = plan, start
    for _ in range(MOST_ROUNDS):
        found = min(
            ((scorer.cost(next_plan), next_plan) for next_plan in _moves(reading, best, bounds)),
            key=lambda pair: pair[0],
            default=None,
        )
        if found is None or not found[0] < cost:
            break
        cost, best = found
    needed = replace(cost, trace=0.0) < replace(start, trace=0.0)
    return best if needed or cost.trace < (1.0 - CLEAR_GAIN) * start.trace else plan


def _moves(reading: Reading, plan: Plan, bounds: Bounds) -> Iterator[Plan]:
    """Yield the plans one step away: add, drop, hand over, swap."""
    free = [robot for robot in reading.robots if robot.free and robot.id in plan]
    for target in reading.targets:
        near = _nearest(reading, free, target.id)
        holders = [robot for robot in free if target.id in plan[robot.id]]
        for robot in near:
            if target.id in plan[robot.id]:
                continue
            for given_up in (None, *sorted(plan[robot.id])):
                if given_up is None and len(plan[robot.id]) >= robot.capacity:
                    continue
                taken = _changed(plan, (robot.id, target.id), given_up)
                if taken is None:
                    continue
                for candidate in _rehomed(taken, holders, target.id, given_up):
                    if bounds.allow(candidate):
                        yield candidate
        for robot in holders:
            dropped = {**plan, robot.id: plan[robot.id] - {target.id}}
            if bounds.allow(dropped):
                yield dropped


def _rehomed(
    taken: Plan, holders: list[SeenRobot], target_id: int, given_up: int | None
) -> Iterator[Plan]:
    """Yield a plan in which a robot has taken a target: shared, handed over, or swapped."""
    yield taken
    for holder in holders:
        handed = {**taken, holder.id: taken[holder.id] - {target_id}}
        yield handed
        if given_up is not None and given_up not in handed[holder.id]:
            yield {**handed, holder.id: handed[holder.id] | {given_up}}


def _changed(plan: Plan, pair: Pair, given_up: int | None) -> Plan | None:
    robot_id, target_id = pair
    row = plan[robot_id] | {target_id}
    return {**plan, robot_id: row - {given_up} if given_up is not None else row}


def _nearest(reading: Reading, free: list[SeenRobot], target_id: int) -> list[SeenRobot]:
    place = next((t.position for t in reading.targets if t.id == target_id), None)
    if place is None:
        return free[:NEAREST]
    return sorted(
        free,
        key=lambda robot: (
            (robot.position[0] - place[0]) ** 2 + (robot.position[1] - place[1]) ** 2,
            robot.id,
        ),
    )[:NEAREST]


# ---------------------------------------------------------------------------- comments


def _grant(
    reading: Reading, plan: Plan, bounds: Bounds, comment: SeenComment, wish: Wish
) -> tuple[Plan, Reaction]:
    """Do what a comment asks of the assignment, or say why not."""
    unknown = _unknown(reading, wish)
    if unknown:
        return plan, Reaction(comment.label, "declined", unknown)
    if wish.kind is WishKind.SPREAD:
        return _one_each(reading, plan, bounds, comment)
    wanted = wish.kind is WishKind.FOCUS
    applied: list[str] = []
    refused: list[str] = []
    already: list[str] = []
    for pair in [(robot, target) for robot in wish.robots for target in wish.targets]:
        words = f"Drone {pair[0]} and Target {pair[1]}"
        if (pair[1] in plan.get(pair[0], ())) is wanted:
            already.append(words)
            (bounds.required if wanted else bounds.forbidden)[pair] = comment.label
            continue
        changed, why = _least_change(reading, plan, bounds, pair, wanted=wanted)
        if changed is None:
            refused.append(why)
            continue
        plan = changed
        bounds.follow(plan)
        (bounds.required if wanted else bounds.forbidden)[pair] = comment.label
        applied.append(words)
    return plan, _reaction(comment, wish, applied, refused, already)


def _reaction(
    comment: SeenComment, wish: Wish, applied: list[str], refused: list[str], already: list[str]
) -> Reaction:
    focus = wish.kind is WishKind.FOCUS
    if refused:
        verdict = "partly_applied" if applied else "declined"
        return Reaction(comment.label, verdict, " ".join(dict.fromkeys(refused)))
    if applied:
        verb = "tracks" if focus else "no longer tracks"
        pairs = "; ".join(words.replace(" and ", f" {verb} ") for words in applied)
        return Reaction(comment.label, "applied", f"{pairs} from now on.")
    verb = "tracks" if focus else "does not track"
    pairs = "; ".join(words.replace(" and ", f" {verb} ") for words in already)
    return Reaction(comment.label, "noted", f"{pairs} already, and keeps to it.")


def _least_change(
    reading: Reading, plan: Plan, bounds: Bounds, pair: Pair, *, wanted: bool
) -> tuple[Plan | None, str]:
    """Return the plan nearest to the present one that grants a pair at no cost of cover."""
    robot_id, target_id = pair
    robot = next(robot for robot in reading.robots if robot.id == robot_id)
    if robot.lost:
        return None, f"Drone {robot_id} is lost."
    if robot.cut_off:
        return None, f"Drone {robot_id} is cut off and cannot be told."
    pins = bounds.forbidden if wanted else bounds.required
    if pins.get(pair) == "":
        return None, "The operator has fixed this pair otherwise."
    wanted_bounds = Bounds(dict(bounds.required), dict(bounds.forbidden))
    for table in (wanted_bounds.required, wanted_bounds.forbidden):
        table.pop(pair, None)
    (wanted_bounds.required if wanted else wanted_bounds.forbidden)[pair] = ""
    scorer = Scorer(reading, one_each=False)
    now = scorer.cost(plan)
    found = [
        (_distance(plan, candidate), scorer.cost(candidate), candidate)
        for candidate in _ways(reading, plan, pair, wanted=wanted)
        if wanted_bounds.allow(candidate)
    ]
    able = [entry for entry in found if _duties(entry[1]) <= _duties(now)]
    if not able:
        # A newer comment goes before an older one.
        older = [p for p, label in bounds.required.items() if label]
        if older and wanted:
            fewer = Bounds(
                {p: label for p, label in bounds.required.items() if not label},
                dict(bounds.forbidden),
                bounds.one_each,
            )
            return _least_change(reading, plan, fewer, pair, wanted=wanted)
        return None, _why_not(robot, target_id, wanted=wanted)
    best = min(able, key=lambda entry: (entry[0], entry[1]))
    return best[2], ""


def _ways(reading: Reading, plan: Plan, pair: Pair, *, wanted: bool) -> Iterator[Plan]:
    """Yield plans that grant a pair: added, exchanged, handed over, swapped."""
    robot_id, target_id = pair
    others = [r for r in reading.robots if r.free and r.id != robot_id and r.id in plan]
    if not wanted:
        freed = {**plan, robot_id: plan[robot_id] - {target_id}}
        yield freed
        for other in others:
            taken = {**freed, other.id: freed[other.id] | {target_id}}
            yield taken
            for target in sorted(plan[other.id] - {target_id}):
                swapped = {**taken, other.id: taken[other.id] - {target}}
                yield swapped
                yield {**swapped, robot_id: swapped[robot_id] | {target}}
        return
    added = {**plan, robot_id: plan[robot_id] | {target_id}}
    yield added
    for given_up in sorted(plan[robot_id]):
        exchanged = {**added, robot_id: added[robot_id] - {given_up}}
        yield exchanged
        for other in others:
            yield {**exchanged, other.id: exchanged[other.id] | {given_up}}
            if target_id in plan[other.id]:
                yield {**exchanged, other.id: (exchanged[other.id] - {target_id}) | {given_up}}


def _distance(plan: Plan, other: Plan) -> int:
    return sum(len(plan[robot_id] ^ other[robot_id]) for robot_id in plan)


def _why_not(robot: SeenRobot, target_id: int, *, wanted: bool) -> str:
    if wanted and robot.capacity == 0:
        return f"Drone {robot.id} can track no target."
    if wanted:
        return f"With Target {target_id} for Drone {robot.id} another target would have no drone."
    return f"No other drone has room for Target {target_id}."


def _one_each(
    reading: Reading, plan: Plan, bounds: Bounds, comment: SeenComment
) -> tuple[Plan, Reaction]:
    """One drone per target, as in the paper's case study."""
    bounds.one_each = True
    single = _improved(reading, plan, bounds)
    if single == plan:
        words = "Each target already has a drone of its own; the weights can do more."
        return plan, Reaction(comment.label, "noted", words)
    words = "Each target has one drone of its own now, so that it is clear who tracks what."
    return single, Reaction(comment.label, "applied", words)


def _capacity(
    reading: Reading, comment: SeenComment, wish: Wish, capacities: tuple[tuple[int, int], ...]
) -> tuple[Reading, tuple[tuple[int, int], ...], Reaction]:
    """Let a robot track fewer (or more) targets, where no target loses its cover by it."""
    unknown = _unknown(reading, replace(wish, targets=()))
    robots = [r for r in reading.robots if r.id in wish.robots and r.free]
    if unknown or not robots or wish.number is None:
        words = unknown or "It is not clear which drone is meant."
        return reading, capacities, Reaction(comment.label, "declined", words)
    if all(robot.capacity == wish.number for robot in robots):
        words = "That is the capacity assumed already."
        return reading, capacities, Reaction(comment.label, "noted", words)
    changed = tuple(
        replace(robot, capacity=wish.number) if robot in robots else robot
        for robot in reading.robots
    )
    room = sum(robot.capacity for robot in changed if not robot.lost)
    if not comment.new or wish.number > len(reading.targets) or room < len(reading.targets):
        words = "With that capacity not every target would have a drone."
        return reading, capacities, Reaction(comment.label, "declined", words)
    if "capacities" not in reading.offers:
        words = "Capacities cannot be changed here."
        return reading, capacities, Reaction(comment.label, "declined", words)
    asked = (*capacities, *((robot.id, wish.number) for robot in robots))
    names = " and ".join(f"Drone {robot.id}" for robot in robots)
    words = f"{names} tracks at most {wish.number} from now on."
    return replace(reading, robots=changed), asked, Reaction(comment.label, "applied", words)


def _elsewhere(reading: Reading, wish: Wish) -> tuple[str, str]:
    """Answer a comment that the assignment cannot help with."""
    if wish.kind is WishKind.NONE:
        return "declined", "This is no guidance for the assignment of drones to targets."
    unknown = _unknown(reading, wish)
    if unknown:
        return "declined", unknown
    return "noted", "The weights and zones see to this; the assignment stays."


def _unknown(reading: Reading, wish: Wish) -> str:
    """Say which robots or targets of a comment do not exist."""
    robots = [r for r in wish.robots if r not in {robot.id for robot in reading.robots}]
    targets = [t for t in wish.targets if t not in {target.id for target in reading.targets}]
    missing = [f"Drone {r}" for r in robots] + [f"Target {t}" for t in targets]
    return f"There is no {' and no '.join(missing)}." if missing else ""


def _feedback(reading: Reading, before: Plan, after: Plan) -> str:
    changes = [
        f"Drone {robot_id} now tracks "
        + (" and ".join(f"Target {t}" for t in sorted(row)) or "no target")
        for robot_id, row in after.items()
        if row != before.get(robot_id, frozenset())
    ]
    if not changes:
        return "The assignment stays: no other is clearly better."
    blind = [f"Drone {robot.id}" for robot in reading.robots if robot.blind]
    why = f"; {' and '.join(blind)} cannot see" if blind else ""
    return f"{'; '.join(changes)}{why}."
