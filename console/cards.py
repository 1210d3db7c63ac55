"""Decision cards as they come: those of older recordings lack fields, and must not stop a panel."""

from typing import Any, Final

Json = dict[str, Any]

_BLANK: Final[Json] = {
    "id": "?", "status": "", "changed": False, "changes": {}, "loop": "", "author": "",
    "feedback": "", "refused_by": "", "reasons": [], "comments": [], "facts": [], "tries": 0,
}  # fmt: skip
_CHANGES: Final[Json] = {
    "assignment": [], "weights": {}, "capacities": {}, "severities": {},
    "pins_set": [], "pins_lifted": [], "replan": [],
}  # fmt: skip
_OPTIONAL: Final[dict[str, Json]] = {
    "gate": dict.fromkeys(("mode", "judgement", "reason"), "")
    | dict.fromkeys(("difference_m2", "horizon_s", "margin_m2")),
    "effect": dict.fromkeys(("predicted_merit_m2", "realised_merit_m2", "from_s", "until_s"))
    | {"overlapped_by": []},
    "approval": {"approved": None, "by": "somebody"},
    "verification": {"accepted": False, "violations": []},
}


def whole(decision: Json) -> Json:
    """Return a decision with every field that a card looks at; blank are those it lacks."""
    found = {name: _known(decision, name, blank) for name, blank in _BLANK.items()}
    found["changes"] = {n: _known(found["changes"], n, blank) for n, blank in _CHANGES.items()}
    for name, blanks in _OPTIONAL.items():
        part = decision.get(name)
        found[name] = None if part is None else blanks | part
    return decision | found


def _known(part: Json, name: str, blank: Any) -> Any:
    value = part.get(name)
    return blank if value is None else value


def is_quiet(decision: Json) -> bool:
    """Tell whether a decision asked for nothing new, and nobody was refused anything."""
    return decision.get("status") == "adopted" and not decision.get("changed")


def assigned_robots(decision: Json) -> list[int]:
    """Return the robots whose targets a decision changes, of whatever standing it is."""
    rows = _known(_known(decision, "changes", {}), "assignment", [])
    return [row["robot"] for row in rows]
