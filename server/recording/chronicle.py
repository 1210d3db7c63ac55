"""What a lockstep mission tells: the same snapshots and events as a live one, for its recording."""

from collections.abc import Mapping
from typing import Any

from server.encoding import EventKind, MissionState, Severity
from server.gate.decisions import Attempt, Decision
from server.live.herald import Herald
from server.loops import LoopReport
from server.mission.setup import MissionSetup
from server.recording.writer import RecordingWriter
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from vehicles import messages as wire
from vehicles.translation import Sender, truth_message
from vehicles.world.world import World

NO_LOOPS: Mapping[str, LoopReport] = {}


class Chronicle:
    """Writes a lockstep mission's story beside its tape."""

    def __init__(self, mission: str, setup: MissionSetup, writer: RecordingWriter) -> None:
        self._writer = writer
        self._sender = Sender("lockstep")
        self.herald = Herald(mission, setup, writer.tell)

    def note(self, snapshot: Snapshot, world: World) -> None:
        """Take a finished step: what the team knows, and what is true after its move."""
        hits = {kind: world.hits(kind) for kind in ZoneKind}
        truth = truth_message(
            self._sender.header("truth", world.time_s),
            world.truth(),
            wire.WorldState.RUNNING,
            wire.HitsPart(
                sensing=hits[ZoneKind.SENSING], communication=hits[ZoneKind.COMMUNICATION]
            ),
        )
        self._writer.truth(truth)
        self.herald.announce(snapshot)
        self.herald.show(snapshot, MissionState.RUNNING, NO_LOOPS, hits, truth)

    def decide(self, card: Decision, attempts: tuple[Attempt, ...]) -> None:
        """Take a decision card that is new or changed."""
        self.herald.decision(card, attempts)

    def close(self, result: dict[str, Any]) -> None:
        """Take the mission's figures."""
        words = "The mission's time is over."
        self.herald.say(EventKind.ENDED, Severity.INFO, words, {"result": result})
