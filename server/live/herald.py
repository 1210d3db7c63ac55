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
from server.gate.decisions import Attempt, Decision, Refuser, Status
from server.gate.encoding import decision_object, decision_words, exchange_object
from server.gate.keeper import EXCHANGES_KEPT
from server.live.channel import Json
from server.live.complaints import Complaints
from server.live.news import news
from server.loops import LoopReport
from server.mission.setup import MissionSetup
from solver.directives import Source
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from vehicles.messages import Mode, Truth
from vehicles.team_link import Notice
from vehicles.translation import zone_of

_MODELS = frozenset({Source.TASK_LLM, Source.ACTION_LLM})
_THEIR_OWN = frozenset({Refuser.NO_ANSWER, Refuser.PARSING, Refuser.VERIFICATION})
"""What only the model is to blame for: the warning about its loop tells it, and not each time."""

_TROUBLE = frozenset({"duplicate", "refused", "dropped", "unknown"})


class Herald:
    """Owner of what has been told. Numbers its events from 1."""

    def __init__(
        self,
        mission: str,
        setup: MissionSetup,
        tell: Callable[[Json], None],
        now: Callable[[], float] | None = None,
    ) -> None:
        self._mission = mission
        self._setup = setup
        self._tell = tell
        self._now = now
        self._seq = 0
        self._last: Snapshot | None = None
        self._time_s = 0.0
        self._feedback: dict[str, str] = {}
        self._complaints = Complaints()
        self._exchanged: dict[str, None] = {}

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
                severity_bounds=setup.severity_bounds,
                zone_defaults={kind: setup.zone_defaults(kind) for kind in ZoneKind},
                attacks=hits,
                truth=None if truth is None else truth_message(truth),
                stamp_s=None if self._now is None else self._now(),
            )
        )

    def notice(self, notice: Notice) -> None:
        """Tell what a robot or the link said to people, unless the news tell it already."""
        flies = notice.code == "mode" and notice.text.startswith(Mode.FLYING)
        if flies or notice.code == "recovery":
            return
        who = "" if notice.robot_id is None else f"Robot {notice.robot_id}: "
        severity = Severity.WARNING if notice.code in _TROUBLE else Severity.INFO
        data: Json = {"code": notice.code}
        if notice.robot_id is not None:
            data["robot"] = notice.robot_id
        self.say(EventKind.LINK, severity, f"{who}{notice.text}", data)

    def outcome(self, consultation: Consultation, outcome: Outcome, card: Decision) -> None:
        """Tell what a consultation came to, with the model's own words; no word twice running."""
        loop = consultation.loop.value
        data: Json = {"loop": loop, "tries": consultation.stats.tries}
        who = f"The {loop} model"
        self._refused_tries(consultation)
        if isinstance(outcome, GivenUp):
            reasons = "; ".join(outcome.reasons)
            calls = self._complaints.failed(loop, reasons, self._time_s)
            if calls is not None:
                running = "" if calls == 1 else f" ({calls} calls in a row)"
                text = f"{who} gave no valid answer{running}: {reasons}"
                self.say(EventKind.LOOP, Severity.WARNING, text, data)
        elif isinstance(outcome, Accepted):
            if calls := self._complaints.mended(loop):
                many = "call" if calls == 1 else "calls"
                text = f"{who} answers again, after {calls} {many} without a valid answer."
                self.say(EventKind.LOOP, Severity.INFO, text, data)
            feedback = outcome.proposal.feedback.strip()
            if not card.accepted:
                text = f"{who} was refused: {'; '.join(card.reasons)}"
                self.say(EventKind.VERDICT, Severity.WARNING, text, data)
            elif feedback and self._feedback.get(loop) != feedback:
                self._feedback[loop] = feedback
                self.say(EventKind.PROPOSAL, Severity.INFO, f"{who}: {feedback}", data)

    def _refused_tries(self, consultation: Consultation) -> None:
        """Tell every try that another one followed; the card tells the last."""
        for number, attempt in enumerate(consultation.attempts[:-1], start=1):
            text = (
                f"The {consultation.loop.value} model's try {number} was refused: "
                f"{'; '.join(attempt.reasons)}"
            )
            data = {
                "loop": consultation.loop.value,
                "proposal": consultation.proposal_id,
                "try": number,
                "fault": None if attempt.fault is None else attempt.fault.value,
            }
            self.say(EventKind.VERDICT, Severity.INFO, text, data)

    def decision(self, card: Decision, attempts: tuple[Attempt, ...]) -> None:
        """Tell of a new or changed card; its prompts and answers go beside it, once."""
        if attempts and card.id not in self._exchanged:
            self._exchanged[card.id] = None
            while len(self._exchanged) > EXCHANGES_KEPT:
                del self._exchanged[next(iter(self._exchanged))]
            self._tell({"type": "exchange", **exchange_object(card.id, attempts)})
        models_own = card.source in _MODELS and card.refused_by in _THEIR_OWN
        refused = card.status is not Status.ADOPTED and not models_own
        severity = Severity.WARNING if refused and card.effect is None else Severity.INFO
        data = {"decision": decision_object(card)}
        self.say(EventKind.DECISION, severity, decision_words(card), data)

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


def truth_message(truth: Truth) -> Json:
    """Return what a simulated world says as the stream tells it."""
    return truth_object(
        {robot.id: robot.position for robot in truth.robots},
        {target.id: target.position for target in truth.targets},
        [zone_of(zone) for zone in truth.zones],
    )
