import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from server.lockstep.job import PAPER_LATENCY, ScriptedComment
from server.recording.errors import RecordingError
from server.recording.fork import Change, fork
from server.recording.reader import Recording, open_recording
from server.recording.writer import RecordingWriter
from server.settings import load_settings
from tests.server.recording.conftest import Flight
from tests.server.recording.flown import FOCUS

KEYS = ("accumulated_trace", "sensing_attacks", "communication_attacks")


def forked(recording: Recording, change: Change) -> dict[str, Any]:
    return asyncio.run(fork(recording, change, load_settings(), lambda done: None))


@pytest.mark.parametrize("at_s", [0.0, 12.3, 40.0])
def test_without_a_change_a_fork_is_what_happened(alone: Flight, at_s: float) -> None:
    story = forked(open_recording(alone[0]), Change(at_s, "none", PAPER_LATENCY))
    assert story["at_s"] == int(at_s * 2) / 2
    assert story["until_s"] == 44.5
    for key in KEYS:
        assert story["forked"][key] == pytest.approx(story["recorded"][key], abs=1e-4)


def test_another_comment_makes_another_story(alone: Flight) -> None:
    said = (ScriptedComment(12.0, FOCUS),)
    story = forked(open_recording(alone[0]), Change(10.0, "mock", PAPER_LATENCY, said))
    (receipt,) = story["result"]["comments"]
    assert receipt["status"] == "applied"
    assert receipt["time_s"] == 12.0
    assert story["forked"] != story["recorded"]


def test_comments_before_the_fork_stand_and_are_counted(guided: Flight) -> None:
    said = (ScriptedComment(30.0, "The robots should be more aggressive."),)
    story = forked(open_recording(guided[0]), Change(20.0, "mock", PAPER_LATENCY, said))
    assert [receipt["id"] for receipt in story["result"]["comments"]] == ["c1", "c2"]


def test_other_dice_are_met_only_after_the_fork(alone: Flight) -> None:
    recording = open_recording(alone[0])
    one = forked(recording, Change(10.0, "none", PAPER_LATENCY, seed=11))
    two = forked(recording, Change(10.0, "none", PAPER_LATENCY, seed=11))
    assert one["forked"] == two["forked"]
    assert one["forked"] != one["recorded"]


def test_real_vehicles_are_flown_on_from_what_was_believed(alone: Flight, tmp_path: Path) -> None:
    source = open_recording(alone[0])
    path = tmp_path / "real.mcap"
    with RecordingWriter(path, replace(source.header, world=None)) as writer:
        for entry in source.entries():
            writer.write(entry)
    story = forked(open_recording(path), Change(20.0, "none", PAPER_LATENCY))
    assert story["recorded"] == {}, "no snapshots were recorded"
    assert story["forked"]["accumulated_trace"] > 0.0
    assert story["result"]["steps"] == 49


@pytest.mark.parametrize("at_s", [-1.0, 44.5, 1e6])
def test_an_instant_outside_the_recording_is_refused(alone: Flight, at_s: float) -> None:
    with pytest.raises(RecordingError, match=r"44\.5 s"):
        forked(open_recording(alone[0]), Change(at_s, "none", PAPER_LATENCY))
