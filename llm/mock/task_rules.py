"""The mock's assignments: near targets, sound cover, few changes, what the human asked for."""

from collections.abc import Iterator
from dataclasses import replace

from llm.mock.comment_rules import TASK_KINDS, Wish, WishKind
from llm.mock.comment_text import wishes
from llm.mock.deciding import (
    FOREIGN_WORDS,
    Reaction,
    TaskDecision,
    combined,
    unclear_words,
    unknown_words,
)
from llm.mock.reading import Reading, SeenComment, SeenRobot
from llm.mock.scoring import Plan, Scorer
from llm.mock.search import CLEAR_GAIN, SMALL_GAIN, Bounds, Pair, duties, improved, sound


def decide(reading: Reading) -> TaskDecision:
    """Return an assignment for a task prompt."""
    bounds = Bounds(
        required={(p.robot, p.target): "" for p in reading.pins if not p.forbids},
        forbidden={(p.robot, p.target): "" for p in reading.pins if p.forbids},
    )
    current: Plan = {robot.id: frozenset(robot.row) for robot in reading.robots if not robot.lost}
    plan = sound(reading, current, bounds)
    reactions: list[Reaction] = []
    capacities: tuple[tuple[int, int], ...] = ()
    asked_anew = keen = False
    for comment in reading.comments:
        if comment.verdict == "declined":
            continue
        parts = []
        for wish in wishes(comment.text):
            if wish.kind is WishKind.CAPACITY:
                reading, capacities, reaction = _capacity(reading, comment, wish, capacities)
                plan = sound(reading, plan, bounds)
            elif wish.kind in TASK_KINDS:
                plan, reaction = _grant(reading, plan, bounds, comment, wish)
            else:
                reaction = Reaction(comment.label, *_elsewhere(reading, wish))
            parts.append(reaction)
            keen = keen or wish.kind is WishKind.TRACK_MORE
            asked_anew = asked_anew or (comment.new and wish.kind in TASK_KINDS)
        if comment.new:
            reactions.append(combined(comment.label, parts))
    gain = SMALL_GAIN if keen else CLEAR_GAIN
    better = plan if asked_anew else improved(reading, plan, bounds, gain)
    rows = tuple(
        (robot.id, tuple(sorted(better[robot.id])))
        for robot in reading.robots
        if robot.free and robot.id in better
    )
    feedback = _feedback(reading, current, better)
    return TaskDecision(rows, feedback, tuple(reactions), capacities)


# ---------------------------------------------------------------------------- comments


def _grant(
    reading: Reading, plan: Plan, bounds: Bounds, comment: SeenComment, wish: Wish
) -> tuple[Plan, Reaction]:
    """Do what a comment asks of the assignment, or say why not."""
    unknown = unknown_words(reading, wish.robots, wish.targets)
    if unknown:
        return plan, Reaction(comment.label, "declined", unknown)
    if wish.kind is WishKind.SPREAD:
        return _one_each(reading, plan, bounds, comment)
    wanted = wish.kind is WishKind.FOCUS
    robots = wish.robots or (_everyone(reading) if wish.everyone else ())
    if wanted and (able := _too_few_places(reading, robots, wish.targets)):
        return plan, Reaction(comment.label, "declined", able)
    applied: list[str] = []
    refused: list[str] = []
    already: list[str] = []
    for pair in [(robot, target) for robot in robots for target in wish.targets]:
        words = f"Drone {pair[0]} and Target {pair[1]}"
        if (pair[1] in plan.get(pair[0], ())) is wanted:
            already.append(words)
            (bounds.required if wanted else bounds.forbidden)[pair] = comment.label
            continue
        changed, why = _least_change(reading, plan, bounds, pair, wish.kind)
        if changed is None:
            refused.append(why)
            continue
        plan = changed
        bounds.follow(plan)
        (bounds.required if wanted else bounds.forbidden)[pair] = comment.label
        applied.append(words)
    return plan, _reaction(comment, wish, applied, refused, already)


def _everyone(reading: Reading) -> tuple[int, ...]:
    return tuple(robot.id for robot in reading.robots if robot.free)


def _too_few_places(
    reading: Reading, robots: tuple[int, ...], targets: tuple[int, ...]
) -> str | None:
    """Say which robot is asked to track more targets than it can."""
    for robot in reading.robots:
        if robot.id in robots and robot.free and len(targets) > robot.capacity > 0:
            many = "target" if robot.capacity == 1 else "targets"
            return f"Drone {robot.id} can track at most {robot.capacity} {many}."
    return None


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
    reading: Reading, plan: Plan, bounds: Bounds, pair: Pair, kind: WishKind
) -> tuple[Plan | None, str]:
    """Return the plan nearest to the present one that grants a wish at no cost of cover.

    Where there is none, None and the reason. The kind is FOCUS or RELEASE: the pair is to be, or
    is not to be.
    """
    robot_id, target_id = pair
    wanted = kind is WishKind.FOCUS
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
        for candidate in (_ways_to_take if wanted else _ways_to_give_up)(reading, plan, pair)
        if wanted_bounds.allow(candidate)
    ]
    able = [entry for entry in found if duties(entry[1]) <= duties(now)]
    if not able:
        # A newer comment goes before an older one.
        older = [p for p, label in bounds.required.items() if label]
        if older and wanted:
            fewer = Bounds(
                {p: label for p, label in bounds.required.items() if not label},
                dict(bounds.forbidden),
                bounds.one_each,
            )
            return _least_change(reading, plan, fewer, pair, kind)
        return None, _why_not(robot, target_id, kind)
    best = min(able, key=lambda entry: (entry[0], entry[1]))
    return best[2], ""


def _ways_to_take(reading: Reading, plan: Plan, pair: Pair) -> Iterator[Plan]:
    """Yield plans in which a pair is: added, exchanged, handed over, swapped."""
    robot_id, target_id = pair
    added = {**plan, robot_id: plan[robot_id] | {target_id}}
    yield added
    for given_up in sorted(plan[robot_id]):
        exchanged = {**added, robot_id: added[robot_id] - {given_up}}
        yield exchanged
        for other in _others(reading, plan, robot_id):
            yield {**exchanged, other: exchanged[other] | {given_up}}
            if target_id in plan[other]:
                yield {**exchanged, other: (exchanged[other] - {target_id}) | {given_up}}


def _ways_to_give_up(reading: Reading, plan: Plan, pair: Pair) -> Iterator[Plan]:
    """Yield plans in which a pair is not: dropped, handed over, swapped."""
    robot_id, target_id = pair
    freed = {**plan, robot_id: plan[robot_id] - {target_id}}
    yield freed
    for other in _others(reading, plan, robot_id):
        taken = {**freed, other: freed[other] | {target_id}}
        yield taken
        for target in sorted(plan[other] - {target_id}):
            swapped = {**taken, other: taken[other] - {target}}
            yield swapped
            yield {**swapped, robot_id: swapped[robot_id] | {target}}


def _others(reading: Reading, plan: Plan, robot_id: int) -> list[int]:
    return [r.id for r in reading.robots if r.free and r.id != robot_id and r.id in plan]


def _distance(plan: Plan, other: Plan) -> int:
    return sum(len(plan[robot_id] ^ other[robot_id]) for robot_id in plan)


def _why_not(robot: SeenRobot, target_id: int, kind: WishKind) -> str:
    if kind is WishKind.FOCUS and robot.capacity == 0:
        return f"Drone {robot.id} can track no target."
    if kind is WishKind.FOCUS:
        return f"With Target {target_id} for Drone {robot.id} another target would have no drone."
    return f"No other drone has room for Target {target_id}."


def _one_each(
    reading: Reading, plan: Plan, bounds: Bounds, comment: SeenComment
) -> tuple[Plan, Reaction]:
    """One drone per target, as in the paper's case study."""
    bounds.one_each = True
    single = improved(reading, plan, bounds)
    if single == plan:
        words = "Each target already has a drone of its own; the weights can do more."
        return plan, Reaction(comment.label, "noted", words)
    words = "Each target has one drone of its own now, so that it is clear who tracks what."
    return single, Reaction(comment.label, "applied", words)


def _capacity(
    reading: Reading, comment: SeenComment, wish: Wish, capacities: tuple[tuple[int, int], ...]
) -> tuple[Reading, tuple[tuple[int, int], ...], Reaction]:
    """Let a robot track fewer (or more) targets, where no target loses its cover by it."""
    unknown = unknown_words(reading, wish.robots, ())
    meant = wish.robots or (_everyone(reading) if wish.everyone else ())
    robots = [r for r in reading.robots if r.id in meant and r.free]
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
    # Each robot once: what is said last counts.
    asked = tuple({**dict(capacities), **{robot.id: wish.number for robot in robots}}.items())
    names = " and ".join(f"Drone {robot.id}" for robot in robots)
    verb = "tracks" if len(robots) == 1 else "track"
    words = f"{names} {verb} at most {wish.number} from now on."
    return replace(reading, robots=changed), asked, Reaction(comment.label, "applied", words)


def _elsewhere(reading: Reading, wish: Wish) -> tuple[str, str]:
    """Answer a comment that the assignment cannot help with."""
    if wish.kind is WishKind.NONE:
        return "declined", "This is no guidance for the assignment of drones to targets."
    if wish.kind is WishKind.FOREIGN:
        return "declined", FOREIGN_WORDS
    if wish.kind is WishKind.UNCLEAR:
        return "declined", unclear_words(wish.words)
    unknown = unknown_words(reading, wish.robots, wish.targets)
    if unknown:
        return "declined", unknown
    return "noted", "The weights and zones see to this; the assignment stays."


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
