import time
from pathlib import Path

import pytest

from tests.vehicles.mavlink.sent import Speaker, heartbeat
from vehicles.mavlink.codec import COMPANION, Codec
from vehicles.mavlink.signing import SigningError, SigningKey, read_key

SECRET = bytes(range(32))
YEAR_2026_S = 1_767_225_600.0


def key(secret: bytes = SECRET, wall_s: float = YEAR_2026_S, started_s: float = 50.0) -> SigningKey:
    return SigningKey(secret, wall_s, started_s)


def heard(codec: Codec, frame: bytes, now_s: float = 50.0) -> int:
    return len(codec.decode(frame, now_s))


@pytest.fixture
def codec() -> Codec:
    return Codec(245, COMPANION, 7, key())


def test_the_same_key_is_heard(codec: Codec) -> None:
    speaker = Speaker(key=key())
    assert heard(codec, speaker.say(heartbeat(), 51.0)) == 1
    assert heard(codec, speaker.say(heartbeat(), 52.0)) == 1


@pytest.mark.parametrize("other", [None, SigningKey(bytes(32), YEAR_2026_S, 50.0)])
def test_no_key_or_another_is_not(codec: Codec, other: SigningKey | None) -> None:
    assert heard(codec, Speaker(key=other).say(heartbeat(), 51.0)) == 0
    assert codec.counts.bad == 1


def test_a_replay_is_refused(codec: Codec) -> None:
    frame = Speaker(key=key()).say(heartbeat(), 51.0)
    assert heard(codec, frame) == 1
    assert heard(codec, frame) == 0


def test_a_recording_of_yesterday_is_refused(codec: Codec) -> None:
    stale = Speaker(key=key(wall_s=YEAR_2026_S - 86_400.0))
    assert heard(codec, stale.say(heartbeat(), 51.0)) == 0


def test_a_forged_frame_from_the_future_silences_nobody(codec: Codec) -> None:
    speaker = Speaker(key=key())
    assert heard(codec, speaker.say(heartbeat(), 51.0)) == 1
    forger = Speaker(key=key(secret=bytes(32), wall_s=YEAR_2026_S + 1e8))
    assert heard(codec, forger.say(heartbeat(), 51.0)) == 0
    assert heard(codec, speaker.say(heartbeat(), 52.0)) == 1


def test_a_forged_first_frame_silences_nobody(codec: Codec) -> None:
    forger = Speaker(key=key(secret=bytes(32), wall_s=YEAR_2026_S + 1e8))
    assert heard(codec, forger.say(heartbeat(), 51.0)) == 0
    assert heard(codec, Speaker(key=key()).say(heartbeat(), 52.0)) == 1


def test_timestamps_follow_the_monotonic_clock() -> None:
    # 10 us ticks since the start of 2015; the wall clock counts only at the start.
    one = key(wall_s=1_420_070_400.0 + 10.0)
    assert one.timestamp(50.0) == 1_000_000
    assert one.timestamp(51.5) == 1_150_000
    assert one.timestamp(0.0) == 1_000_000


def test_the_wall_clock_may_jump_in_flight(codec: Codec, monkeypatch: pytest.MonkeyPatch) -> None:
    speaker = Speaker(key=key())
    assert heard(codec, speaker.say(heartbeat(), 51.0)) == 1
    past = time.time() - 3600.0
    monkeypatch.setattr(time, "time", lambda: past)
    assert heard(codec, speaker.say(heartbeat(), 52.0), 52.0) == 1


@pytest.mark.parametrize("content", [SECRET, SECRET.hex().encode(), SECRET.hex().encode() + b"\n"])
def test_key_files(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "key"
    path.write_bytes(content)
    path.chmod(0o600)
    assert read_key(path) == SECRET


def test_key_files_that_do_not_serve(tmp_path: Path) -> None:
    path = tmp_path / "key"
    with pytest.raises(SigningError, match="cannot read"):
        read_key(path)
    path.write_bytes(b"short")
    path.chmod(0o600)
    with pytest.raises(SigningError, match="neither"):
        read_key(path)
    path.write_bytes(SECRET)
    path.chmod(0o644)
    with pytest.raises(SigningError, match="others may read"):
        read_key(path)


def test_the_secret_is_not_shown() -> None:
    assert "secret" not in repr(key())
