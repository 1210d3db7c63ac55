"""The messages: what is written down is what is checked, and nothing else gets through."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.vehicles.samples import RULES, SAMPLES, TRACK, ZONE
from vehicles import messages as wire
from vehicles.fields import Wire
from vehicles.rule_parts import InferencePart, RulesPart
from vehicles.world_messages import Happening

INFERENCE = RULES["inference"]
RETURN: dict[str, Any] = {"type": "return", "tracks": [], "zones": []}
PAGE = Path(__file__).resolve().parents[2] / "docs" / "messages.md"
KINDS = sorted(SAMPLES, key=lambda kind: kind.__name__)


def payload(kind: type[wire.Message], **changes: Any) -> bytes:
    return json.dumps({**SAMPLES[kind], **changes}).encode()


# ---------------------------------------------------------------------- the page


def tables() -> Iterator[tuple[str, str, set[str]]]:
    """Yield (section, sentence before the table, documented fields)."""
    section, words, fields = "", "", set[str]()
    for line in [*PAGE.read_text().splitlines(), ""]:
        if line.startswith("## "):
            section = line.removeprefix("## ")
        row = re.match(r"\| `([a-z0-9_]+)` \|", line)
        if row:
            fields.add(row[1])
        elif fields:
            yield section, words, fields
            words, fields = "", set()
        if line and not line.startswith("|"):
            words = line


def documented(section: str, words: str = "") -> set[str]:
    found = [f for where, before, f in tables() if where == section and words in before]
    assert found, f"no table under {section!r} after {words!r}"
    return found[0]


@pytest.mark.parametrize("kind", KINDS)
def test_every_message_is_documented_field_by_field(kind: type[wire.Message]) -> None:
    common = documented("Rules for every message")
    assert common == set(wire.Message.model_fields)
    assert documented(kind.__name__) == set(kind.model_fields) - common


@pytest.mark.parametrize(
    ("part", "section", "words"),
    [
        (wire.SightingPart, "Detections", "A sighting"),
        (wire.AttackPart, "Event", "An attack"),
        (wire.RecoveryPart, "Event", "A recovery"),
        (wire.ModePart, "Event", "A mode change"),
        (wire.ReturnPart, "Event", "A return"),
        (wire.NoticePart, "Event", "A notice"),
        (RulesPart, "Knowledge", "Its rules"),
        (InferencePart, "Knowledge", "How a robot infers"),
        (wire.ZonePart, "Knowledge", "A zone"),
        (wire.TrackPart, "Knowledge", "A track"),
        (wire.TrueRobotPart, "Truth", "A true robot"),
    ],
)
def test_every_part_is_documented_field_by_field(
    part: type[Wire], section: str, words: str
) -> None:
    assert documented(section, words) == set(part.model_fields)


def test_every_message_has_a_sample_and_every_mode_and_order_is_named() -> None:
    assert set(SAMPLES) == set(wire.Message.__subclasses__())
    page = PAGE.read_text()
    for word in (*wire.Mode, *wire.Order, *wire.PlannerState, *wire.WorldAction, *Happening):
        assert f"`{word.value}`" in page


# ---------------------------------------------------------------------- the checks


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_survives_the_wire(kind: type[wire.Message]) -> None:
    message = wire.decode(kind, payload(kind))
    again = wire.decode(kind, wire.encode(message))
    assert again == message
    assert json.loads(wire.encode(message)) == wire.decode(kind, payload(kind)).model_dump(
        mode="json"
    )


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_left_out_is_missed_and_what_is_new_is_not_minded(
    kind: type[wire.Message],
) -> None:
    for name in SAMPLES[kind]:
        rest = {key: value for key, value in SAMPLES[kind].items() if key != name}
        with pytest.raises(wire.MessageError, match=name):
            wire.decode(kind, json.dumps(rest).encode())
    wire.decode(kind, payload(kind, added_later=[1, 2]))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("version", [0, 2, "1", None, 1.5])
def test_another_version_is_refused(kind: type[wire.Message], version: object) -> None:
    with pytest.raises(wire.MessageError, match="v: "):
        wire.decode(kind, payload(kind, v=version))


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        (wire.State, {"position": [float("nan"), 0.0]}),
        (wire.State, {"position": [float("inf"), 0.0]}),
        (wire.State, {"position": [1e300, 0.0]}),
        (wire.State, {"position": [1.0]}),
        (wire.State, {"position": ["1.0", 2.0]}),
        (wire.State, {"velocity": [1e5, 0.0]}),
        (wire.State, {"robot_id": -1}),
        (wire.State, {"robot_id": 2**40}),
        (wire.State, {"robot_id": "21"}),
        (wire.State, {"boot": ""}),
        (wire.State, {"boot": "a/b"}),
        (wire.State, {"seq": -1}),
        (wire.State, {"seq": 2**60}),
        (wire.State, {"stamp_s": -1.0}),
        (wire.State, {"mode": "drifting"}),
        (wire.State, {"sensing_failed": 1}),
        (wire.Setpoint, {"ttl_s": 0.0}),
        (wire.Setpoint, {"ttl_s": 11.0}),
        (wire.Setpoint, {"velocity": [None, 0.0]}),
        (wire.Setpoint, {"mission": ""}),
        (wire.Detections, {"sightings": [{"target_id": 1, "range_m": 1.0, "bearing_rad": 4.0}]}),
        (wire.Event, {"event": {"type": "party"}}),
        (wire.Event, {"event": {"type": "attack", "kind": "sensing"}}),
        (
            wire.Event,
            {"event": {"type": "return", "tracks": [{**TRACK, "mean": [1.0]}], "zones": []}},
        ),
        (wire.Event, {"event": {**RETURN, "silent": [[1.0, None]]}}),
        (wire.Event, {"event": {**RETURN, "silent": [[0.0, 1.1e7]]}}),
        (wire.Event, {"event": {**RETURN, "silent": [[0.0, 0.0]] * 257}}),
        (wire.Knowledge, {"zones": [{**ZONE, "risk": 0.6}]}),
        (wire.Knowledge, {"zones": [{**ZONE, "covariance": [[1.0, 2.0], [2.0, 1.0]]}]}),
        (wire.Knowledge, {"zones": [{**ZONE, "covariance": [[1.0, 0.5], [0.1, 1.0]]}]}),
        (wire.Knowledge, {"zones": [ZONE] * 257}),
        (wire.Knowledge, {"tracks": [{**TRACK, "mean": [1.0, 2.0, 3.0]}]}),
        (wire.Knowledge, {"tracks": [{**TRACK, "covariance": [[1.0, 0.0]]}]}),
        (wire.Knowledge, {"rules": {**RULES, "step_s": 0.0}}),
        (wire.Knowledge, {"rules": {**RULES, "horizon": 1000}}),
        (wire.Knowledge, {"rules": {**RULES, "inference": {**INFERENCE, "period_s": 0.0}}}),
        (wire.Knowledge, {"rules": {**RULES, "inference": {**INFERENCE, "risk": 0.6}}}),
        (wire.Knowledge, {"weights": [1.0, 1.0, 1.0]}),
        (wire.Knowledge, {"weights": [1.0, 1.0, 1.0, -1.0]}),
        (wire.Command, {"command": "arm"}),
        (wire.Command, {"author": "x" * 101}),
        (wire.Heartbeat, {"tick": -2}),
        (wire.WorldControl, {"seed": -1}),
    ],
)
def test_what_breaks_a_bound_is_refused(kind: type[wire.Message], changes: dict[str, Any]) -> None:
    (name,) = changes
    with pytest.raises(wire.MessageError, match=f"{kind.__name__}: .*{name}"):
        wire.decode(kind, payload(kind, **changes))


@pytest.mark.parametrize("text", [b"", b"null", b"[]", b"{", b"\xff\xfe", b"[" * 100_000, b"1e999"])
def test_what_is_no_object_is_refused(text: bytes) -> None:
    with pytest.raises(wire.MessageError):
        wire.decode(wire.State, text)


def test_too_much_is_refused_unread_and_refusals_do_not_repeat_what_was_said() -> None:
    with pytest.raises(wire.MessageError, match="bytes are more than"):
        wire.decode(wire.State, b" " * (wire.MAX_PAYLOAD + 1))
    with pytest.raises(wire.MessageError) as refusal:
        wire.decode(wire.State, payload(wire.State, mode="<script>" * 100))
    assert "<script>" not in str(refusal.value)
    assert len(str(refusal.value)) < 500


@given(st.binary(max_size=300))
@example(b'{"v":1}')
def test_random_bytes_never_do_more_than_be_refused(data: bytes) -> None:
    for kind in KINDS:
        with pytest.raises(wire.MessageError):
            wire.decode(kind, data)


JUNK = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


@given(st.sampled_from(KINDS), st.data())
def test_junk_in_a_field_is_refused_or_was_valid(
    kind: type[wire.Message], data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(sorted(SAMPLES[kind])))
    try:
        message = wire.decode(kind, payload(kind, **{name: data.draw(JUNK)}))
    except wire.MessageError:
        return
    assert wire.decode(kind, wire.encode(message)) == message
