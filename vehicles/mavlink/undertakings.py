"""What takes an autopilot several steps: ask, wait for proof, ask again, give up.

The proof of a step is what the vehicle reports, never the acknowledgement alone; an
acknowledgement only ends the asking, so that a pilot who overrules us is not asked over.
"""

from collections.abc import Callable
from dataclasses import dataclass

from vehicles.mavlink.commands import COMMANDS, Action, Arm, ChangeMode, Climb
from vehicles.mavlink.dialects import Dialect, TakeOff
from vehicles.mavlink.protocol import mavlink
from vehicles.mavlink.telemetry import Telemetry
from vehicles.messages import Order

TRIES = 3
RETRY_S = 1.0
PROOF_S = 2.5
"""How long after its acceptance an action may take to show; heartbeats come once a second."""

CLIMB_S = 60.0
REACHED = 0.9
"""Part of the take-off altitude that counts as reached."""

LIFTED_M = 0.3
"""Height that shows a take-off where the autopilot does not tell whether it is landed."""

_PENDING = frozenset({mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS})
_BUSY = mavlink.MAV_RESULT_TEMPORARILY_REJECTED


@dataclass(frozen=True, slots=True)
class Step:
    """One thing to reach: by an action, or by waiting."""

    words: str
    action: Action | None
    proof: Callable[[Telemetry], bool]
    patience_s: float
    """How long it may take, counted from its start or from its acceptance."""


class Undertaking:
    """Steps on the way to one order, one after the other.

    `failure` is None until it fails; `done` tells that every step is proved.
    """

    def __init__(self, order: Order, order_id: str, steps: tuple[Step, ...], now_s: float) -> None:
        self.order = order
        self.order_id = order_id
        self.failure: str | None = None
        self._steps = list(steps)
        self._tries = 0
        self._accepted = False
        self._next_s = now_s
        self._deadline_s = now_s + _patience_s(self._steps)

    @property
    def done(self) -> bool:
        """Whether every step is proved."""
        return not self._steps and self.failure is None

    @property
    def step(self) -> Step | None:
        """The step it is at."""
        return self._steps[0] if self._steps else None

    def advance(self, telemetry: Telemetry, now_s: float) -> Action | None:
        """Return what to send now, if anything."""
        while self._steps and self._steps[0].proof(telemetry):
            self._steps.pop(0)
            self._begin(now_s)
        if not self._steps or self.failure is not None:
            return None
        step = self._steps[0]
        if now_s > self._deadline_s:
            self.failure = f"{step.words}: nothing came of it"
            return None
        if step.action is None or self._accepted or now_s < self._next_s:
            return None
        if self._tries == TRIES:
            self.failure = f"{step.words}: no answer after {TRIES} tries"
            return None
        self._tries += 1
        self._next_s = now_s + RETRY_S
        return step.action

    def answer(self, command: int, result: int, now_s: float) -> None:
        """Take an acknowledgement; one that answers something else is ignored."""
        step = self.step
        if step is None or step.action is None or COMMANDS.get(type(step.action)) != command:
            return
        if not self._tries or self._accepted:
            return
        if result in _PENDING:
            self._accepted = True
            self._deadline_s = now_s + step.patience_s
        elif result != _BUSY:
            self.failure = f"{step.words}: refused by the autopilot (result {result})"

    def _begin(self, now_s: float) -> None:
        self._tries = 0
        self._accepted = False
        self._next_s = now_s
        self._deadline_s = now_s + _patience_s(self._steps)


def engage(dialect: Dialect, order: Order, order_id: str, now_s: float) -> Undertaking:
    """Return the way to have a flying vehicle follow us."""
    return Undertaking(order, order_id, _following(dialect, now_s), now_s)


def leave(mode: int, dialect: Dialect, order: Order, order_id: str, now_s: float) -> Undertaking:
    """Return the way to have the autopilot land or return by itself."""
    return Undertaking(order, order_id, (_mode(dialect, mode),), now_s)


def take_off(dialect: Dialect, altitude_m: float, order_id: str, now_s: float) -> Undertaking:
    """Return the way from the ground to an altitude above the local origin, following us."""
    steps = [*_following(dialect, now_s), Step("arm", Arm(), lambda told: told.armed, PROOF_S)]
    if dialect.take_off is TakeOff.COMMAND:
        climb = Climb(altitude_m)
        steps.append(Step("take off", climb, _off_the_ground, 2 * PROOF_S))
    high = REACHED * altitude_m
    steps.append(Step("climb", None, lambda told: told.position[2] >= high, CLIMB_S))
    return Undertaking(Order.TAKE_OFF, order_id, tuple(steps), now_s)


def _patience_s(steps: list[Step]) -> float:
    return steps[0].patience_s + TRIES * RETRY_S if steps else 0.0


def _off_the_ground(told: Telemetry) -> bool:
    return not told.landed and (told.landed is False or told.position[2] > LIFTED_M)


def _following(dialect: Dialect, now_s: float) -> tuple[Step, ...]:
    """Return the steps to the following mode; the guard streams setpoints meanwhile."""
    ready_s = now_s + dialect.stream_first_s
    mode = _mode(dialect, dialect.follow)
    if not dialect.stream_first_s:
        return (mode,)

    def streamed(told: Telemetry) -> bool:
        return told.position_s is not None and told.position_s >= ready_s

    return (Step("stream setpoints", None, streamed, 2 * dialect.stream_first_s), mode)


def _mode(dialect: Dialect, mode: int) -> Step:
    words = f"change to {dialect.name(mode)}"
    return Step(words, ChangeMode(mode), lambda told: told.mode == mode, PROOF_S)
