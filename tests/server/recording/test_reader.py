import random
import shutil
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from server.mission.tape import Began, Committed, Observed, Proposed
from server.recording.errors import RecordingError
from server.recording.reader import open_recording
from server.recording.topics import TAPE, topics
from tests.server.recording.conftest import Flight
from tests.server.recording.flown import FOCUS


def test_the_header_tells_the_whole_mission(guided: Flight) -> None:
    header = open_recording(guided[0]).header
    assert (header.clock, header.llm, header.engine, header.tick_s) == (
        "lockstep", "mock", "sqp", 0.5,
    )  # fmt: skip
    assert header.setup.robot_ids == (0, 1)
    assert header.world is not None
    assert [zone.zone.id for zone in header.world.zones] == ["s0", "s1", "c0"]


def test_the_tape_holds_every_input_and_output(guided: Flight) -> None:
    entries = list(open_recording(guided[0]).entries())
    kinds = [type(entry) for entry in entries]
    assert kinds.count(Began) == kinds.count(Committed) == 90
    assert Proposed in kinds
    said = [e.observation for e in entries if isinstance(e, Observed)]
    assert FOCUS in {getattr(observation, "text", "") for observation in said}


def test_decisions_are_told_and_each_ends_decided(guided: Flight) -> None:
    cards = {
        event["data"]["decision"]["id"]: event["data"]["decision"]
        for event in open_recording(guided[0]).events()
        if event["kind"] == "decision"
    }
    made = guided[1]["task_llm"]["calls"] + guided[1]["action_llm"]["calls"]
    assert len(cards) >= made > 0
    assert {card["status"] for card in cards.values()} <= {"adopted", "refused"}
    assert any(card["changed"] and "c1" in card["comments"] for card in cards.values())


def test_one_snapshot_of_every_stretch(guided: Flight) -> None:
    recording = open_recording(guided[0])
    times = [snapshot["time_s"] for snapshot in recording.sampled(2.0)]
    assert times == [2.0 * number for number in range(23)]


def test_snapshots_by_time(guided: Flight) -> None:
    recording = open_recording(guided[0])
    assert recording.complete
    assert recording.duration_s == 44.5
    assert [s["time_s"] for s in recording.snapshots(10.0, 11.0)] == [10.0, 10.5, 11.0]
    found = recording.snapshot_at(20.7)
    assert found is not None
    assert found["time_s"] == 20.5
    assert recording.snapshot_at(-1.0) is None
    truth = recording.truth_at(20.7)
    assert truth is not None
    assert truth.time_s == 21.0, "the truth after the move of the tick at 20.5 s"


def test_a_common_reader_finds_every_topic_with_its_schema(guided: Flight) -> None:
    with guided[0].open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    named = {
        channel.topic: summary.schemas[channel.schema_id].name
        for channel in summary.channels.values()
    }
    assert named == {topic.name: topic.schema_name for topic in topics()}
    counts = summary.statistics.channel_message_counts if summary.statistics else {}
    assert all(counts[channel_id] > 0 for channel_id in summary.channels)


def test_a_file_cut_anywhere_behind_its_header_opens(guided: Flight, tmp_path: Path) -> None:
    data = guided[0].read_bytes()
    whole = list(open_recording(guided[0]).entries())
    draw = random.Random(5)
    cut = tmp_path / "cut.mcap"
    for _ in range(40):  # two hundred, of a long flight: benchmarks/ordeal.py
        cut.write_bytes(data[: draw.randrange(5000, len(data) - 1)])
        recording = open_recording(cut)
        assert not recording.complete
        entries = list(recording.entries())
        assert entries == whole[: len(entries)]


def test_a_damaged_chunk_is_told_and_never_passed_on(guided: Flight, tmp_path: Path) -> None:
    data = bytearray(guided[0].read_bytes())
    middle = len(data) // 2
    for at in range(middle, middle + 64):
        data[at] ^= 0xFF
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(data)
    with pytest.raises(RecordingError, match=r"damaged|cut off"):
        list(open_recording(bad).entries())


@pytest.mark.parametrize("size", [0, 4, 20, 400])
def test_a_file_without_a_header_says_so(guided: Flight, tmp_path: Path, size: int) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(guided[0].read_bytes()[:size])
    with pytest.raises(RecordingError, match="cut off before its header"):
        open_recording(cut)


def test_other_files_are_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="No such file"):
        open_recording(tmp_path / "nothing.mcap")
    text = tmp_path / "text.mcap"
    text.write_text("not a recording at all")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        open_recording(text)
    foreign = tmp_path / "foreign.mcap"
    with foreign.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(RecordingError, match="not a recording of Falconer"):
        open_recording(foreign)


def test_an_entry_of_another_kind_is_told(guided: Flight, tmp_path: Path) -> None:
    source = open_recording(guided[0])
    path = tmp_path / "odd.mcap"
    from server.recording.header import METADATA_NAME, header_metadata

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata(METADATA_NAME, header_metadata(source.header))
        schema = writer.register_schema("falconer.TapeEntry", "jsonschema", b"{}")
        channel = writer.register_channel(TAPE, "json", schema)
        writer.add_message(channel, 0, b'{"kind": "dreamt"}', 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(RecordingError, match="tape cannot be read at 0 s"):
        list(open_recording(path).entries())


def test_a_file_that_is_removed_while_it_is_read_is_told(guided: Flight, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    shutil.copy(guided[0], path)
    recording = open_recording(path)
    path.unlink()
    for read in (recording.snapshots, recording.events, recording.entries):
        with pytest.raises(RecordingError, match="No such file"):
            next(read())
    with pytest.raises(RecordingError, match="No such file"):
        recording.snapshot_at(1.0)
    path.write_bytes(guided[0].read_bytes()[:100])
    with pytest.raises(RecordingError, match="ends too soon"):
        next(recording.snapshots())
