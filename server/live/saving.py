"""When a live mission tells what it would need to go on in another process, and how."""

from collections.abc import Callable
from typing import Final

from server.live.channel import Json
from server.live.herald import truth_message
from server.live.outbox import CHECKPOINT
from server.mission.checkpoint import checkpoint_text
from server.mission.core import MissionCore
from solver.snapshot import Snapshot
from vehicles.messages import Truth

CHECKPOINT_S: Final = 1.0
"""A checkpoint is told so often, and at once when people or models have decided something."""


class Saver:
    """Owner of what has been saved."""

    def __init__(
        self,
        mission: str,
        core: MissionCore,
        tell: Callable[[Json], None],
        figures: Callable[[], Json],
    ) -> None:
        self._mission = mission
        self._core = core
        self._tell = tell
        self._figures = figures
        self._saved: object = None
        self._saved_s = -CHECKPOINT_S

    def look(self, snapshot: Snapshot, truth: Truth | None) -> None:
        """Send a checkpoint when something changed, or in turn."""
        relevant = (
            self._core.directives,
            snapshot.zones,
            snapshot.receipts,
            len(snapshot.closed),
        )
        if relevant != self._saved or snapshot.time_s >= self._saved_s + CHECKPOINT_S:
            self._saved, self._saved_s = relevant, snapshot.time_s
            self._tell(self.checkpoint(truth))

    def checkpoint(self, truth: Truth | None) -> Json:
        """Return the message of a checkpoint as of now."""
        checkpoint = self._core.checkpoint()
        return {
            "type": CHECKPOINT,
            "mission": self._mission,
            "time_s": checkpoint.time_s,
            "core": checkpoint_text(checkpoint),
            "figures": self._figures(),
            "truth": None if truth is None else truth_message(truth),
        }
