"""What both drivers of the model loops share: what to ask, what wakes a loop, how to count.

Live and lockstep ask the same questions from the same snapshots; only the clock differs.
"""

from dataclasses import dataclass

from llm.consultation import Consultation, consult_action, consult_task
from llm.history import History
from llm.prompts import PromptView
from server.mission.core import MissionCore
from server.result import LoopTally
from solver.observations import Link
from solver.snapshot import Snapshot, TrackStatus


@dataclass(frozen=True, slots=True)
class Wake:
    """Which loops an event concerns."""

    task: bool
    action: bool


class Advisors:
    """Makes the consultations of one mission and notices what should wake its loops."""

    def __init__(self, core: MissionCore) -> None:
        self._core = core
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

    def task(self) -> Consultation:
        """Return a new question to the task model."""
        return consult_task(self._view(), self._name("t"))

    def action(self) -> Consultation:
        """Return a new question to the action model."""
        return consult_action(self._view(), self._name("a"))

    def _view(self) -> PromptView:
        return PromptView(
            snapshot=self._core.snapshot,
            history=self._history.entries,
            limits=self._core.limits,
            attacks=self._history.latest_attacks,
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
    tally.tokens_in.append(stats.tokens_in)
    tally.tokens_out.append(stats.tokens_out)


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
