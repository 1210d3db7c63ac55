import random

import pytest

from tests.vehicles.mavlink.sent import Speaker, heartbeat, local_position
from vehicles.mavlink.codec import COMPANION, MAX_DATAGRAM, Codec


@pytest.fixture
def codec() -> Codec:
    return Codec(245, COMPANION, 7, None)


def names(codec: Codec, datagram: bytes) -> list[str]:
    return [message.get_type() for message in codec.decode(datagram, 0.0)]


def test_sound_frames_come_through(codec: Codec) -> None:
    speaker = Speaker()
    both = speaker.say(heartbeat()) + speaker.say(local_position())
    assert names(codec, both) == ["HEARTBEAT", "LOCAL_POSITION_NED"]
    assert codec.counts.accepted == 2


def test_a_wrong_checksum_is_refused(codec: Codec) -> None:
    frame = bytearray(Speaker().say(heartbeat()))
    frame[-1] ^= 1
    assert names(codec, bytes(frame)) == []
    assert codec.counts.bad == 1


def test_another_system_is_refused(codec: Codec) -> None:
    assert names(codec, Speaker(system=8).say(heartbeat())) == []
    assert codec.counts.foreign == 1


def test_messages_of_another_dialect_are_ignored(codec: Codec) -> None:
    # Id 150 (SENSOR_OFFSETS) is ArduPilot's own: its checksum cannot be checked here.
    frame = bytes([0xFD, 2, 0, 0, 0, 7, 1, 150, 0, 0, 1, 2, 3, 4])
    assert names(codec, frame) == []
    assert codec.counts.unknown == 1


def test_half_a_frame_does_not_eat_the_next_datagram(codec: Codec) -> None:
    speaker = Speaker()
    assert names(codec, speaker.say(local_position())[:20]) == []
    assert codec.counts.truncated == 1
    assert names(codec, speaker.say(heartbeat())) == ["HEARTBEAT"]


def test_a_huge_datagram_is_refused_unread(codec: Codec) -> None:
    frame = Speaker().say(heartbeat())
    assert names(codec, frame * (MAX_DATAGRAM // len(frame) + 1)) == []
    assert codec.counts.oversized == 1


def test_noise_is_only_counted(codec: Codec) -> None:
    dice = random.Random(1)
    for _ in range(200):
        assert names(codec, dice.randbytes(dice.randrange(400))) == []
    assert codec.counts.accepted == 0
    assert names(codec, Speaker().say(heartbeat())) == ["HEARTBEAT"]


def test_frames_are_numbered_and_ours(codec: Codec) -> None:
    frames = [codec.encode(heartbeat(), 0.0) for _ in range(257)]
    assert [frame[4] for frame in frames] == [*range(256), 0]
    assert {(frame[0], frame[5], frame[6]) for frame in frames} == {(0xFD, 245, COMPANION)}
