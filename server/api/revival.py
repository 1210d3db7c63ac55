"""Bringing missions back after the server has died: what the journal knows of each.

A mission that was live comes up held, from its newest checkpoint; comments that were committed
after that checkpoint are added to it. A simulated world that died with the server goes on with
its robots and targets where they were last.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import structlog

from server.api.alarms import AlarmBook
from server.api.catalogue import Definition
from server.api.chronicle import definition_of
from server.api.models import Clock, CommentModel
from server.encoding import EventKind, MissionState, comment_object
from server.journal.entry import EntryKind, Sealed
from server.journal.journal import Journal
from server.live.figures import FiguresError, KeptFigures, read_figures
from server.live.job import dump_job, load_job
from server.mission.checkpoint import Checkpoint, CheckpointError, read_checkpoint
from solver.observations import Comment
from solver.snapshot import CommentReceipt

log = structlog.get_logger(__name__)

ENDED_KEPT: Final = 20
"""Missions that are over are shown again after a restart, the newest ones."""

MOST_KEPT: Final = 80
"""Of all missions."""

EVENTS_READ: Final = 3000
EVENTS_PAGE: Final = 500

OVERLAP_S: Final = 5.0
"""Comments said so long before a checkpoint that lacks them were closed, not lost."""

DELETED: Final = "deleted"

BusOf = Callable[[Mapping[str, Any]], dict[str, Any]]
"""Where a stored planner job stands on the bus now."""

_LIVE: Final = frozenset(
    {MissionState.QUEUED, MissionState.RUNNING, MissionState.HELD, MissionState.PAUSED}
)
_GOES_ON: Final = _LIVE | {MissionState.FAILED}


@dataclass(frozen=True, slots=True)
class Remains:
    """What is left of a mission that was broken off: where it goes on."""

    definition: Definition
    """As the mission was made."""

    start: Checkpoint | None = None
    """None where it never came so far; then it begins."""

    figures: KeptFigures | None = None
    truth: dict[str, Any] | None = None
    """Where its simulated world stood."""

    kept_at: datetime | None = None
    """Wall clock of the checkpoint."""

    def away_s(self) -> float:
        """Return for how long nobody has planned, by the wall clock, never less than 0."""
        if self.kept_at is None:
            return 0.0
        return max(0.0, (datetime.now(UTC) - self.kept_at).total_seconds())


@dataclass(frozen=True, slots=True)
class Revived:
    """One mission as the journal knows it."""

    id: str
    definition: Definition
    state: MissionState
    reason: str
    created_at: datetime
    events: int
    """How many it has told."""

    samples: int
    comments: tuple[CommentModel, ...]
    decisions: tuple[dict[str, Any], ...]
    """The newest state of its last cards, oldest first."""

    alarms: AlarmBook
    """As its last events make them."""

    result: dict[str, Any] | None
    remains: Remains

    @property
    def broken_off(self) -> bool:
        """Whether it was live when the server died."""
        return self.state in _LIVE


async def revived(journal: Journal, bus: BusOf) -> tuple[int, list[Revived]]:
    """Return the highest number of any mission, and the missions to show again, oldest first.

    Raises JournalUnavailable.
    """
    entries = await journal.missions()
    highest = max((_number(entry.mission) for entry in entries), default=0)
    found: list[Revived] = []
    ended = 0
    for entry in reversed(entries):
        last = await _last_state(journal, entry.mission)
        over = last["state"] == MissionState.ENDED
        if last["state"] == DELETED or (over and ended >= ENDED_KEPT):
            continue  # a journal of years is not read through at each start
        mission = await _revive(journal, entry, last, bus)
        if mission is None:
            continue
        ended += over
        found.append(mission)
        if len(found) >= MOST_KEPT:
            break
    return highest, found[::-1]


async def _last_state(journal: Journal, mission: str) -> dict[str, Any]:
    states = await journal.read(mission, (EntryKind.STATE,), limit=100_000)
    return states[-1].data if states else {"state": MissionState.CREATED, "reason": ""}


async def _revive(
    journal: Journal, made: Sealed, last: Mapping[str, Any], bus: BusOf
) -> Revived | None:
    """Return a mission whose newest state is `last`, None for one that cannot be shown."""
    mission = made.mission
    try:
        stored = made.data["definition"]
        if stored["clock"] == Clock.REPLAY:
            return None  # the recording is there; whoever wants to see it opens it again
        definition = definition_of(stored, bus(stored["planner"]))
        state = MissionState(last["state"])
    except (KeyError, TypeError, ValueError) as error:
        log.warning("a mission of the journal cannot be read", mission=mission, why=str(error))
        return None
    said = await _comments(journal, mission)
    kept = await journal.checkpoint(mission) if state in _GOES_ON else None
    remains = Remains(definition) if kept is None else remains_of(kept, definition, said)
    start = remains.start
    decisions, alarms = await _told(journal, mission)
    if state is MissionState.ENDED:
        alarms.close()
    known = [] if start is None else [*start.closed, *start.standing]
    receipts = {comment.id: CommentReceipt(comment) for comment in said}
    receipts |= {receipt.comment.id: receipt for receipt in known}
    return Revived(
        id=mission,
        definition=definition,
        state=state,
        reason=str(last["reason"]),
        created_at=datetime.fromisoformat(made.at),
        events=await journal.last_number(mission, EntryKind.EVENT),
        samples=await journal.last_number(mission, EntryKind.SAMPLE),
        comments=tuple(
            CommentModel.model_validate(comment_object(receipt)) for receipt in receipts.values()
        ),
        decisions=decisions,
        alarms=alarms,
        result=await _result(journal, mission) if state is MissionState.ENDED else None,
        remains=remains,
    )


async def _comments(journal: Journal, mission: str) -> list[Comment]:
    """Return what was said to a mission and not refused, oldest first."""
    kinds = (EntryKind.COMMENT, EntryKind.COMMENT_REFUSED)
    said: dict[str, Comment] = {}
    for entry in await journal.read(mission, kinds, limit=100_000):
        if entry.kind == EntryKind.COMMENT_REFUSED:
            said.pop(entry.data["id"], None)
        else:
            time_s = 0.0 if entry.time_s is None else entry.time_s
            comment = Comment(entry.data["id"], entry.data["text"], time_s, 0.0, entry.author)
            said[comment.id] = comment
    return list(said.values())


def remains_of(kept: Mapping[str, Any], definition: Definition, said: Iterable[Comment]) -> Remains:
    """Return what is left of a mission: its checkpoint, with what was said since.

    `kept` is the message of a checkpoint, with the wall clock of its keeping as `at`.
    """
    try:
        start = read_checkpoint(str(kept.get("core", "")))
        figures = read_figures(kept["figures"]) if "figures" in kept else None
    except (CheckpointError, FiguresError) as error:
        log.error("a checkpoint cannot be read", mission=kept.get("mission"), why=str(error))
        return Remains(definition)
    loops = definition.planner["setup"].get("loops", {})
    ttl_s = float(loops.get("comment_ttl_s", 120.0))
    known = {receipt.comment.id for receipt in (*start.standing, *start.closed)}
    added = tuple(
        CommentReceipt(replace(comment, ttl_s=ttl_s))
        for comment in said
        if comment.id not in known and comment.time_s > start.time_s - OVERLAP_S
    )
    return Remains(
        definition,
        replace(start, standing=(*start.standing, *added)),
        figures,
        kept.get("truth"),
        datetime.fromisoformat(kept["at"]),
    )


async def _told(journal: Journal, mission: str) -> tuple[tuple[dict[str, Any], ...], AlarmBook]:
    """Return the decision cards among the last events, as told last, and the alarms they make."""
    cards: dict[str, dict[str, Any]] = {}
    alarms = AlarmBook()
    after = max(0, await journal.last_number(mission, EntryKind.EVENT) - EVENTS_READ)
    while page := await journal.page(mission, EntryKind.EVENT, after, EVENTS_PAGE):
        after = page[-1].number or after + EVENTS_PAGE
        for event in (entry.data for entry in page):
            alarms.take(event)
            if event.get("kind") == EventKind.DECISION:
                card = event["data"]["decision"]
                cards[card["id"]] = card
    return tuple(cards.values()), alarms


async def _result(journal: Journal, mission: str) -> dict[str, Any] | None:
    """Return the figures that a mission told of at its end."""
    last = await journal.last_number(mission, EntryKind.EVENT)
    for entry in await journal.page(mission, EntryKind.EVENT, last - 5, 10):
        result = entry.data.get("data", {}).get("result")
        if isinstance(result, dict):
            return result
    return None


def planner_job(mission: Remains, away_s: float) -> dict[str, Any]:
    """Return the job of a planner that goes on where the mission was broken off.

    `away_s` is for how long targets have moved on unseen. Raises JobError for a mission that
    another version wrote.
    """
    if mission.start is None:
        return mission.definition.planner
    job = load_job(mission.definition.planner)
    start = replace(mission.start, away_s=away_s)
    left = tuple(said for said in job.comments if said[0] > start.time_s)
    job = replace(
        job,
        setup=replace(job.setup, start=start),
        comments=left,
        record=None if job.record is None else _beside(job.record, start.time_s),
        comments_said=len(job.comments) - len(left),
        figures=mission.figures,
    )
    return dump_job(job)


def _beside(record: Path, time_s: float) -> Path:
    """Return the file that the rest of a mission is recorded into: none is ever overwritten."""
    return record.with_name(f"{record.stem}-from-{time_s:.0f}s-{datetime.now(UTC):%H%M%S%f}.mcap")


def world_job(mission: Remains) -> dict[str, Any] | None:
    """Return the job of the world, with robots and targets where they were last."""
    job, truth = mission.definition.world, mission.truth
    if job is None or truth is None:
        return job
    world = dict(job["world"])
    for kind in ("robots", "targets"):
        places = {thing["id"]: thing["position"] for thing in truth[kind]}
        world[kind] = [
            {**thing, "position": places.get(thing["id"]) or thing["position"]}
            for thing in world[kind]
        ]
    return {**job, "world": world}


def _number(mission: str) -> int:
    digits = mission.removeprefix("m")
    return int(digits) if digits.isdecimal() else 0
