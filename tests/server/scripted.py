"""A mission that follows a script: moving snapshots without any planner. For tests only."""

import asyncio
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from server.api.catalogue import Definition
from server.api.errors import ServiceError
from server.api.models import LlmProfile, MissionRequest, ScenarioInfo
from server.encoding import (
    EventKind,
    MissionState,
    Severity,
    comment_object,
    event_message,
    snapshot_message,
    truth_object,
)
from server.gate.decisions import Decision, Status
from server.gate.encoding import decision_object
from server.live.channel import ChannelClosed, RequestRefused, frame
from server.live.host import Receive
from server.loops import LoopReport
from server.mission.setup import GateMode, ZoneDefaults
from solver.arrays import frozen, frozen_bool
from solver.directives import CommentVerdict, Directives, Pairing, Pin, Source, Weights
from solver.observations import Comment, HoldState, Link
from solver.problem import Rung
from solver.snapshot import (
    CommentReceipt,
    Guidance,
    RobotTable,
    Snapshot,
    SolveSummary,
    TrackStatus,
    TrackTable,
)
from solver.zones import Zone, ZoneKind
from tests.server.scripted_deciding import adopted, exchange, override_card, proposed, refused
from tests.server.scripted_directing import steered

ROBOTS = (21, 26, 31, 34)
TARGETS = (121, 122, 123, 124, 125, 126)
FIELD = ((-8.0, -5.0), (8.0, 5.0))
LOWER = Weights(1.0, 0.005, 5.0, 5.0)
UPPER = Weights(100.0, 0.5, 500.0, 500.0)
ZONE_DEFAULTS = {
    ZoneKind.SENSING: ZoneDefaults(0.1, 0.1, 0.1),
    ZoneKind.COMMUNICATION: ZoneDefaults(0.2, 0.05, 0.05),
}
FOUND = (
    Zone("s1", ZoneKind.SENSING, (-2.5, 1.0), ((0.8, 0.25), (0.25, 0.5)), 0.1, 0.1),
    Zone("c1", ZoneKind.COMMUNICATION, (2.4, -1.6), ((0.6, 0.0), (0.0, 0.6)), 0.2, 0.05),
)
HIDDEN = (Zone("s2", ZoneKind.SENSING, (5.2, 2.2), ((0.5, 0.0), (0.0, 0.3)), 0.1, 0.1),)


def directives(assignment: frozenset[Pairing] | None = None, **changes: Any) -> Directives:
    """Return directives over the scripted team."""
    start = frozenset(
        {
            Pairing(21, 121),
            Pairing(21, 125),
            Pairing(26, 122),
            Pairing(31, 123),
            Pairing(31, 126),
            Pairing(34, 124),
        }
    )
    return Directives(
        assignment=start if assignment is None else assignment,
        weights=Weights(10.0, 0.05, 50.0, 50.0),
        capacities=tuple((robot, 2) for robot in ROBOTS),
        **changes,
    )


def snapshot(time_s: float = 0.0, **changes: Any) -> Snapshot:
    """Return the scripted team at a time: robots behind targets that circle slowly."""
    angles = np.array([0.05 * time_s + i for i in range(len(TARGETS))])
    radii = np.array([6.0, 5.0, 4.0, 6.5, 3.5, 5.5])
    targets = np.stack([radii * np.cos(angles), 0.6 * radii * np.sin(angles)], axis=1)
    robots = 0.8 * targets[: len(ROBOTS)] + 0.3
    sizes = 0.02 + 0.05 * (1 + np.sin(0.2 * time_s + np.arange(len(TARGETS))))
    covariances = np.array([[[s, 0.4 * s], [0.4 * s, 0.6 * s]] for s in sizes])
    base = Snapshot(
        mission="scripted",
        tick=round(10 * time_s),
        time_s=time_s,
        robots=RobotTable(
            ids=ROBOTS,
            positions=frozen(robots),
            velocities=frozen(np.gradient(robots, axis=0) * 0.02),
            altitudes=frozen([1.0, 1.4, 1.8, 2.2]),
            sensing_failed=frozen_bool([False, True, False, False]),
            links=(Link.CONNECTED, Link.CONNECTED, Link.JAMMED, Link.CONNECTED),
            state_age_s=frozen([0.03, 0.05, 4.2, math.inf]),
            setpoint_velocities=frozen(np.full((4, 2), 0.21)),
            waypoints=frozen(robots + 0.35),
        ),
        tracks=TrackTable(
            ids=TARGETS,
            positions=frozen(targets),
            velocities=frozen(np.zeros((6, 2))),
            covariances=frozen(covariances),
            unseen_s=frozen([0, 0, 0, 2.2, 0, 0]),
            status=(*[TrackStatus.TRACKED] * 3, TrackStatus.COASTING, *[TrackStatus.TRACKED] * 2),
        ),
        zones=FOUND,
        known=frozen_bool([[True, True], [True, False], [True, True], [True, True]]),
        directives=directives(),
        hold=HoldState.FLYING,
        trace=float(np.trace(covariances, axis1=1, axis2=2).sum()),
        solve=SolveSummary(Rung.CONVERGED, 12.3, 5, 0.0021),
        attacks=(),
        receipts=(),
        guidance=Guidance.MODEL,
        guidance_age_s=3.2,
    )
    return replace(base, **changes)


def loop_reports(time_s: float) -> dict[str, LoopReport]:
    """Return plausible figures of the three loops."""
    return {
        "optimizer": LoopReport(round(10 * time_s), 0, 10.0, 0.0031, 1.0, 0.0),
        "task_llm": LoopReport(int(time_s // 20), 0, 0.05, 1.36, 1.0, time_s % 20),
        "action_llm": LoopReport(int(time_s // 5), 1, 0.2, 0.89, 0.8, time_s % 5),
    }


@dataclass
class ScriptedHost:
    """Stands where a mission process stands. A comment is applied after two snapshots."""

    definition: Definition
    period_s: float = 0.1
    fail_start: bool = False
    state: MissionState = MissionState.CREATED
    requests: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    receipts: list[CommentReceipt] = field(default_factory=list)
    answered: set[str] = field(default_factory=set)
    directives: Directives = field(default_factory=directives)
    zones: tuple[Zone, ...] = FOUND
    time_s: float = 0.0
    decided: int = 0
    waiting: dict[str, Decision] = field(default_factory=dict)
    exit_code: "asyncio.Future[int] | None" = None
    ready: asyncio.Event = field(default_factory=asyncio.Event)

    async def run(self, receive: Receive) -> int:
        """Send snapshots until the test ends the process by `crash`."""
        self.exit_code = asyncio.get_running_loop().create_future()
        self._receive = receive
        self.ready.set()
        try:
            while not self.exit_code.done():
                if self.state is not MissionState.CREATED:
                    self._tick()
                await asyncio.wait({self.exit_code}, timeout=self.period_s)
            return self.exit_code.result()
        finally:
            self.state = MissionState.ENDED

    def crash(self, code: int = -9) -> None:
        """End as a killed process ends."""
        assert self.exit_code is not None
        self.exit_code.set_result(code)

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> dict[str, Any]:
        """Answer as a mission process answers."""
        await self.ready.wait()
        self.requests.append((op, dict(params or {})))
        match op:
            case "prepare":
                if self.fail_start:
                    raise ChannelClosed("the mission process has ended")
                return {"endpoint": "tcp/127.0.0.1:7"}
            case "start":
                self.state = MissionState.RUNNING
            case "comment":
                return self._comment(dict(params or {}))
            case "override":
                return self._override(dict(params or {}))
            case "hold":
                self.state = MissionState.HELD
                self.event(EventKind.HOLD, Severity.WARNING, "Hold all: operator")
            case "pause":
                self.state = MissionState.PAUSED
            case "resume":
                self.state = MissionState.RUNNING
                self.event(EventKind.HOLD, Severity.INFO, "Resumed: operator")
            case "stop":
                return {"result": {"scenario": "scripted", "final": True}}
            case "result":
                return {"scenario": "scripted", "final": False}
        return {"state": self.state.value}

    def event(self, kind: EventKind, severity: Severity, text: str, **data: Any) -> None:
        """Tell of an event."""
        self._receive(frame(event_message("scripted", 0, self.time_s, kind, severity, text, data)))

    def say(self, time_s: float) -> None:
        """Send one snapshot."""
        self.time_s = time_s
        hold = HoldState.HELD if self.state is MissionState.HELD else HoldState.FLYING
        picture = snapshot(
            time_s,
            directives=self.directives,
            hold=hold,
            receipts=tuple(self.receipts),
            zones=self.zones,
            known=frozen_bool([[True] * len(self.zones)] * len(ROBOTS)),
        )
        self._receive(
            frame(
                snapshot_message(
                    picture,
                    state=self.state,
                    loops=loop_reports(time_s),
                    field=FIELD,
                    weight_bounds=(LOWER, UPPER),
                    severity_bounds=(1.0, 5.0),
                    zone_defaults=ZONE_DEFAULTS,
                    attacks={ZoneKind.SENSING: 3, ZoneKind.COMMUNICATION: 1},
                    mission="m1",
                    truth=truth_object(
                        dict(zip(ROBOTS, picture.robots.positions.tolist(), strict=True)),
                        dict(zip(TARGETS, picture.tracks.positions.tolist(), strict=True)),
                        (*FOUND, *HIDDEN),
                    ),
                )
            )
        )

    def _tick(self) -> None:
        moving = self.state is MissionState.RUNNING
        self.say(self.time_s + (self.period_s if moving else 0.0))
        for receipt in self.receipts:
            late = self.time_s - receipt.comment.time_s > 2 * self.period_s
            if late and receipt.comment.id not in self.answered:
                self._answer(receipt)

    def _comment(self, params: dict[str, Any]) -> dict[str, Any]:
        if len(self.receipts) >= 32:
            raise RequestRefused("too_many_comments", "32 comments stand already")
        said = params["id"], params["text"], self.time_s, 120.0, params["author"]
        comment = Comment(*said)
        self.receipts.append(CommentReceipt(comment))
        self.event(EventKind.COMMENT, Severity.INFO, f"Comment: {comment.text}")
        return comment_object(self.receipts[-1])

    def _override(self, params: dict[str, Any]) -> dict[str, Any]:
        """Adopt whatever is asked, except for what is unheard of."""
        asked = params["asked"]
        if params["what"] == "approval" and asked["id"] in self.waiting:
            return self._approve(asked["id"], asked["approve"], params["author"])
        if asked.get("id") == "nobody":
            raise RequestRefused("pin_unknown", "There is no pin nobody.")
        if asked.get("weights", [0.0])[0] > 100.0:
            words = "Weight 1 (tracking) must be between 1 and 100, not 1000."
            details = {"field": "weights", "violations": [words]}
            raise RequestRefused("override_refused", words, details)
        self.decided += 1
        done = steered(self.directives, self.zones, params["what"], asked, self.time_s)
        self.directives, self.zones = done.directives, done.zones
        card = override_card(self.decided, self.time_s, params["author"], done.changes)
        self._receive(frame({"type": "exchange", "id": card["id"], "attempts": [{"prompt": "?"}]}))
        self.event(EventKind.DECISION, Severity.INFO, "Adopted.", decision=card)
        if params["what"] == "zone" and done.zone is not None:
            who, zone = params["author"], done.zone["id"]
            about = {"what": "zone", "zone": zone, "did": "drew", "author": who}
            self.event(EventKind.DIRECTIVES, Severity.INFO, f"{who} drew zone {zone}.", **about)
        return {"decision": card, "zone": done.zone}

    def _answer(self, receipt: CommentReceipt) -> None:
        """Propose what is asked: robot 21 takes target 122, robot 26 takes target 125 for it."""
        comment = receipt.comment
        self.answered.add(comment.id)
        self.decided += 1
        decision = proposed(self.decided, comment, self.time_s, self.definition.gate)
        self._receive(frame(exchange(decision)))
        self._tell(decision)
        if decision.status is Status.PENDING:
            self.waiting[decision.id] = decision
        else:
            self._swap(receipt, decision)

    def _approve(self, decision_id: str, approve: bool, by: str) -> dict[str, Any]:
        decision = self.waiting.pop(decision_id)
        receipt = next(r for r in self.receipts if r.comment.id == decision.comment_ids[0])
        if approve:
            decision = adopted(decision, self.time_s, by)
            self._swap(receipt, decision)
        else:
            decision = refused(decision, self.time_s, by)
            self.receipts[self.receipts.index(receipt)] = replace(
                receipt,
                task=CommentVerdict.DECLINED,
                task_reason=decision.reasons[0],
                task_proposal=decision.proposal_id,
                action=CommentVerdict.NOTED,
            )
        self._tell(decision)
        return {"decision": decision_object(decision), "zone": None}

    def _tell(self, decision: Decision) -> None:
        words, card = f"{decision.id}: {decision.status.value}.", decision_object(decision)
        self.event(EventKind.DECISION, Severity.INFO, words, decision=card)

    def _swap(self, receipt: CommentReceipt, decision: Decision) -> None:
        """Do what was proposed."""
        comment = receipt.comment
        swapped = self.directives.assignment - {Pairing(26, 122), Pairing(21, 125)}
        self.directives = replace(
            self.directives,
            assignment=frozenset(swapped | {Pairing(21, 122), Pairing(26, 125)}),
            assignment_source=Source.TASK_LLM,
            assignment_since_s=self.time_s,
            pins=(Pin("p1", Pairing(21, 122), comment.time_s + 120.0, comment.id),),
        )
        self.receipts[self.receipts.index(receipt)] = replace(
            receipt,
            task=CommentVerdict.APPLIED,
            task_reason="Robot 21 takes target 122; robot 26 takes target 125 in exchange.",
            task_proposal=decision.proposal_id,
            action=CommentVerdict.NOTED,
            action_reason="No weight has to change for it.",
        )
        self.event(EventKind.DIRECTIVES, Severity.INFO, "Robot 21 now tracks targets 121, 122.")


class ScriptedCatalogue:
    """One scenario, two profiles."""

    def scenarios(self) -> tuple[ScenarioInfo, ...]:
        return (
            ScenarioInfo(name="scripted", description="A script.", robots=4, targets=6, zones=3),
        )

    def describe(self, scenario: dict[str, Any]) -> ScenarioInfo:
        if set(scenario) != {"name"} or not str(scenario["name"]).isalpha():
            raise ServiceError("scenario_invalid", "name: letters are expected.", 422)
        return ScenarioInfo(name=scenario["name"], description="", robots=4, targets=6, zones=3)

    def bus(self, planner: Mapping[str, Any]) -> dict[str, Any]:
        return {"mode": "client"}

    def profiles(self) -> tuple[LlmProfile, ...]:
        return (
            LlmProfile(name="none", description="No model."),
            LlmProfile(name="mock", description="A rule model."),
        )

    def define(self, request: MissionRequest) -> Definition:
        if request.scenario != "scripted":
            raise ServiceError("scenario_unknown", f"No scenario {request.scenario}.", 422)
        return Definition(
            "scripted",
            request.llm,
            request.seed or 0,
            request.clock,
            request.gate or GateMode.AUTO,
            {"p": 1},
            {"w": 1},
        )

    def model_address(self, profile: str) -> str:
        if profile not in {known.name for known in self.profiles()}:
            raise ServiceError("llm_unknown", f"No profile {profile}.", 422)
        return profile
