"""What a live mission tells the web side: snapshots, and events in plain words."""

from collections.abc import Callable, Mapping
from typing import Any

from llm.consultation import Accepted, Consultation, GivenUp, Outcome
from server.encoding import (
    EventKind,
    MissionState,
    Severity,
    event_message,
    snapshot_message,
    truth_object,
)
from server.live.channel import Json
from server.live.news import news
from server.loops import LoopReport
from server.mission.setup import MissionSetup
from solver.directives import Verdict
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from vehicles.messages import Mode, Truth
from vehicles.team_link import Notice
from vehicles.translation import zone_of

_TROUBLE = frozenset({"duplicate", "refused", "dropped", "unknown"})


class Herald:
    """Owner of what has been told. Numbers its events from 1."""

    def __init__(self, mission: str, setup: MissionSetup, tell: Callable[[Json], None]) -> None:
        self._mission = mission
        self._setup = setup
        self._tell = tell
        self._seq = 0
        self._last: Snapshot | None = None
        self._time_s = 0.0
        self._feedback: dict[str, str] = {}

    def announce(self, snapshot: Snapshot) -> None:
        """Tell the news since the snapshot before."""
        self._time_s = max(0.0, snapshot.time_s)
        for item in news(self._last, snapshot):
            self.say(item.kind, item.severity, item.text, item.data)
        self._last = snapshot

    def show(
        self,
        snapshot: Snapshot,
        state: MissionState,
        loops: Mapping[str, LoopReport],
        hits: Mapping[ZoneKind, int],
        truth: Truth | None,
    ) -> None:
        """Send a snapshot."""
        setup = self._setup
        self._tell(
            snapshot_message(
                snapshot,
                mission=self._mission,
                state=state,
                loops=loops,
                field=(setup.field_lower, setup.field_upper),
                weight_bounds=(setup.weight_lower, setup.weight_upper),
                attacks=hits,
                truth=None if truth is None else _truth_object(truth),
            )
        )

    def notice(self, notice: Notice) -> None:
        """Tell what a robot or the link said to people, unless the news tell it already."""
        flies = notice.code == "mode" and notice.text.startswith(Mode.FLYING)
        if flies or notice.code == "recovery":
            return
        who = "" if notice.robot_id is None else f"Robot {notice.robot_id}: "
        severity = Severity.WARNING if notice.code in _TROUBLE else Severity.INFO
        self.say(EventKind.LINK, severity, f"{who}{notice.text}", {"code": notice.code})

    def outcome(
        self, consultation: Consultation, outcome: Outcome, verdict: Verdict | None
    ) -> None:
        """Tell what a consultation came to, with the model's own words; no word twice running."""
        loop = consultation.loop.value
        data: Json = {"loop": loop, "tries": consultation.stats.tries}
        who = f"The {loop} model"
        if isinstance(outcome, GivenUp):
            text = f"{who} gave no valid answer: {'; '.join(outcome.reasons)}"
            self.say(EventKind.LOOP, Severity.WARNING, text, data)
        elif isinstance(outcome, Accepted) and verdict is not None:
            feedback = outcome.proposal.feedback.strip()
            if not verdict.accepted:
                text = f"{who} was refused: {'; '.join(verdict.violations)}"
                self.say(EventKind.VERDICT, Severity.WARNING, text, data)
            elif feedback and self._feedback.get(loop) != feedback:
                self._feedback[loop] = feedback
                self.say(EventKind.PROPOSAL, Severity.INFO, f"{who}: {feedback}", data)

    def say(
        self,
        kind: EventKind,
        severity: Severity,
        text: str,
        data: Mapping[str, Any] | None = None,
    ) -> None:
        """Send one event."""
        self._seq += 1
        message = event_message(self._mission, self._seq, self._time_s, kind, severity, text, data)
        self._tell(message)


def _truth_object(truth: Truth) -> Json:
    return truth_object(
        {robot.id: robot.position for robot in truth.robots},
        {target.id: target.position for target in truth.targets},
        [zone_of(zone) for zone in truth.zones],
    )
