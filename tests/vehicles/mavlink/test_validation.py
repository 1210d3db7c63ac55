import math

import pytest

from tests.vehicles.mavlink.sent import heartbeat, local_position
from vehicles.mavlink.protocol import Message, mavlink
from vehicles.mavlink.validation import PLAUSIBLE, plausible


def fill(name: str) -> Message:
    """Return a message of a kind with every number 0."""
    kind = next(k for k in mavlink.mavlink_map.values() if k.msgname == name)
    values = [
        b"" if t == "char" else ([0] * length if length > 1 else 0)
        for t, length in zip(kind.fieldtypes, kind.array_lengths, strict=True)
    ]
    return kind(*values)


@pytest.mark.parametrize("name", PLAUSIBLE)
def test_every_range_names_a_field_and_binds(name: str) -> None:
    assert plausible(fill(name))
    for field, (low, high) in PLAUSIBLE[name].items():
        for value, expected in ((low, True), (high, True), (low - 1, False), (high + 1, False)):
            message = fill(name)
            setattr(message, field, value)
            assert plausible(message) is expected, (field, value)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e30])
@pytest.mark.parametrize("field", ["x", "y", "z", "vx", "vy", "vz"])
def test_a_position_is_finite(field: str, bad: float) -> None:
    message = local_position()
    assert plausible(message)
    setattr(message, field, bad)
    assert not plausible(message)


def test_unlisted_messages_have_no_ranges() -> None:
    assert plausible(heartbeat())
    assert plausible(mavlink.MAVLink_ping_message(0, 0, 0, 0))
