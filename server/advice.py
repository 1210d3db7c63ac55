"""What both drivers of the model loops share: what to ask, what wakes a loop, how to count.

Live and lockstep ask the same questions from the same snapshots; only the clock differs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from llm.consultation import Consultation, consult_action, consult_task
from llm.history import History
from llm.prompts import PromptView
from llm.styles import PromptStyle
from server.gate.decisions import Decision, Refuser, Status
from server.gate.decisions import Loop as CardLoop
from server.mission.core import MissionCore
from server.result import LoopTally
from solver.observations import Link
from solver.snapshot import Snapshot, TrackStatus

SILENT_PERIODS = 2.0
"""Task periods without a valid assignment after which our own solver assigns."""

_SILENCES = frozenset({Refuser.NO_ANSWER, Refuser.PARSING, Refuser.VERIFICATION})


Ask = Callable[[], Consultation]
"""Makes a question. It takes its time with a large team, and may do so in another thread."""


@dataclass(frozen=True, slots=True)
class Wake:
    """Which loops an event concerns."""

    task: bool
    action: bool


class Relief:
    """When our own assignment solver steps in for a task model that has fallen silent.

    The third rung of the ladder: a model that has given no valid assignment for
    `SILENT_PERIODS` of its periods, whatever the reason, is stood in for, once per period,
    until it answers again. The weights stay as they are. A model is not silent while a person
    thinks about what it said.

    Args:
        task_period_s: Of the task model's loop.
        began_s: Mission time from which on the model is asked.
    """

    def __init__(self, task_period_s: float, began_s: float) -> None:
        self._period_s = task_period_s
        self._heard_s = began_s
        self._solved_s: float | None = None
        self._considered: set[str] = set()
        """Ids of the cards that wait for a person."""

    def note(self, card: Decision) -> None:
        """Take note of a decision: a valid answer of the task model ends the silence.

        Also where the gate or a person refused it: the model is there. Cards are told again when
        they are decided, and when their effect is known.
        """
        if card.loop is not CardLoop.TASK:
            return
        if card.status is Status.PENDING:
            self._considered.add(card.id)
        else:
            self._considered.discard(card.id)
        if card.refused_by in _SILENCES:
            return
        heard_s = card.time_s if card.decided_s is None else card.decided_s
        if heard_s > self._heard_s:
            self._heard_s = heard_s
            self._solved_s = None

    def due(self, now_s: float) -> bool:
        """Return whether to solve now; true once per period of silence."""
        if self._considered:
            return False
        since_s = self._heard_s + SILENT_PERIODS * self._period_s
        if self._solved_s is not None:
            since_s = self._solved_s + self._period_s
        if now_s < since_s - 1e-9:
            return False
        self._solved_s = now_s
        return True


class Advisors:
    """Makes the consultations of one mission and notices what should wake its loops."""

    def __init__(self, core: MissionCore, style: PromptStyle = PromptStyle.FULL) -> None:
        self._core = core
        self._style = style
        self._history = History()
        self._last: Snapshot | None = None
        self._count = 0

    def look(self, snapshot: Snapshot) -> Wake:
        """Take note of a new snapshot; return which loops its events wake.

        A comment wakes both; an attack or a recovery the action loop; a robot or target lost
        or found the task loop.
        """
        self._history.record(snapshot)
        before, self._last = self._last, snapshot
        if before is None:
            return Wake(task=False, action=False)
        said = _standing(snapshot) - _standing(before)
        links = before.robots.links != snapshot.robots.links
        failures = before.robots.sensing_failed.tolist() != snapshot.robots.sensing_failed.tolist()
        gone = _lost(before) != _lost(snapshot)
        return Wake(
            task=bool(said) or gone,
            action=bool(said) or bool(snapshot.attacks) or links or failures,
        )

    def task(self) -> Ask:
        """Return what makes a new question to the task model, from the snapshot of now."""
        return partial(consult_task, self._view(), self._name("t"))

    def action(self) -> Ask:
        """Return what makes a new question to the action model, from the snapshot of now."""
        return partial(consult_action, self._view(), self._name("a"))

    def _view(self) -> PromptView:
        return PromptView(
            snapshot=self._core.snapshot,
            history=self._history.entries,
            limits=self._core.limits,
            attacks=self._history.latest_attacks,
            style=self._style,
        )

    def _name(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}"


def tally_outcome(tally: LoopTally, consultation: Consultation, *, adopted: bool) -> None:
    """Count a consultation that has ended, as the paper counts."""
    stats = consultation.stats
    tally.calls += 1
    tally.tries += stats.tries
    tally.valid_first += stats.valid_first
    tally.valid += stats.valid
    tally.adopted += adopted
    tally.tokens_in.add(stats.tokens_in)
    tally.tokens_out.add(stats.tokens_out)


def _standing(snapshot: Snapshot) -> set[str]:
    return {receipt.comment.id for receipt in snapshot.receipts}


def _lost(snapshot: Snapshot) -> tuple[set[int], set[int]]:
    robots = {
        robot_id
        for robot_id, link in zip(snapshot.robots.ids, snapshot.robots.links, strict=True)
        if link is Link.LOST
    }
    tracks = snapshot.tracks
    targets = {
        target_id
        for target_id, status in zip(tracks.ids, tracks.status, strict=True)
        if status in (TrackStatus.DROPPED, TrackStatus.UNKNOWN)
    }
    return robots, targets
