"""What a mission needs to go on after its process, or the whole server, has died.

Directives, known zones, comments and tracks; where the robots are they tell themselves. Plain
immutable values, so that the journal keeps it as JSON and a recording's setup can carry it.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from pydantic import TypeAdapter, ValidationError

from solver.arrays import frozen
from solver.beliefs import Beliefs
from solver.directives import Directives
from solver.inferences import KeptHazard
from solver.snapshot import CommentReceipt
from solver.zones import Zone, ZoneKind


@dataclass(frozen=True, slots=True)
class KnownZone:
    """A zone and the robots that know it."""

    zone: Zone
    holders: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class KeptZone:
    """One inferred zone, and its name."""

    name: str
    """Empty for one that is not likely enough to be known."""

    kind: ZoneKind
    hazard: KeptHazard


@dataclass(frozen=True, slots=True)
class KeptTrack:
    """One target as believed: state (x, y[, vx, vy]) and covariance."""

    target_id: int
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    unseen_s: float


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A mission core at one tick."""

    time_s: float
    directives: Directives
    zones: tuple[KnownZone, ...]
    standing: tuple[CommentReceipt, ...]
    closed: tuple[CommentReceipt, ...]
    tracks: tuple[KeptTrack, ...]
    """Of targets that are tracked; the others are unknown again."""

    hazards: tuple[KeptZone, ...] = ()
    """Zones inferred from failures; what speaks for them is told by what is known of them."""

    answered_s: float | None = None
    """Mission time of the last valid answer of a model."""

    away_s: float = 0.0
    """How long targets have moved on unseen while nobody planned; mission time stood still."""


class CheckpointError(ValueError):
    """Raised when an object is not a checkpoint; the message names the fields."""


_CHECKPOINT: Final = TypeAdapter(Checkpoint)


def checkpoint_text(checkpoint: Checkpoint) -> str:
    """Return a checkpoint as JSON text."""
    return _CHECKPOINT.dump_json(checkpoint).decode()


def read_checkpoint(text: str) -> Checkpoint:
    """Return the checkpoint in a JSON text. Raises CheckpointError."""
    try:
        return _CHECKPOINT.validate_json(text)
    except ValidationError as error:
        places = {".".join(map(str, e["loc"])) or "checkpoint" for e in error.errors()}
        raise CheckpointError(f"not a checkpoint: {', '.join(sorted(places))}") from None


def kept_tracks(beliefs: Beliefs) -> tuple[KeptTrack, ...]:
    """Return the tracks of the targets that are known."""
    return tuple(
        KeptTrack(
            target_id=beliefs.ids[row],
            mean=tuple(beliefs.means[row].tolist()),
            covariance=tuple(tuple(line) for line in beliefs.covariances[row].tolist()),
            unseen_s=float(beliefs.unseen_s[row]),
        )
        for row in np.flatnonzero(beliefs.known)
    )


def with_tracks(beliefs: Beliefs, tracks: tuple[KeptTrack, ...]) -> Beliefs:
    """Return beliefs in which kept tracks go on; those of other lengths or targets are left out."""
    means, covariances = beliefs.means.copy(), beliefs.covariances.copy()
    known, unseen = beliefs.known.copy(), beliefs.unseen_s.copy()
    rows = {target_id: row for row, target_id in enumerate(beliefs.ids)}
    for track in tracks:
        row = rows.get(track.target_id)
        if row is None or len(track.mean) != means.shape[1]:
            continue
        means[row], covariances[row] = track.mean, track.covariance
        known[row], unseen[row] = True, track.unseen_s
    return replace(
        beliefs,
        means=frozen(means),
        covariances=frozen(covariances),
        known=known,
        unseen_s=unseen,
        started=beliefs.started | known,
    )
