"""A snapshot message of the scripted team."""

from typing import Any

from server.encoding import MissionState, snapshot_message, truth_object
from solver.zones import ZoneKind
from tests.server.scripted import (
    FIELD,
    FOUND,
    HIDDEN,
    LOWER,
    TARGETS,
    UPPER,
    ZONE_DEFAULTS,
    loop_reports,
    snapshot,
)


def message(time_s: float = 30.0, **changes: Any) -> dict[str, Any]:
    """Return the message at a mission time."""
    picture = snapshot(time_s, **changes)
    places = dict(zip(TARGETS, picture.tracks.positions.tolist(), strict=True))
    return snapshot_message(
        picture,
        mission="m1",
        state=MissionState.RUNNING,
        loops=loop_reports(time_s),
        field=FIELD,
        weight_bounds=(LOWER, UPPER),
        severity_bounds=(1.0, 5.0),
        zone_defaults=ZONE_DEFAULTS,
        attacks={ZoneKind.SENSING: 3, ZoneKind.COMMUNICATION: 1},
        truth=truth_object({}, places, (*FOUND, *HIDDEN)),
    )
