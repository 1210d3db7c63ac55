"""The journal in SQLite: durable, ordered, bounded, and back after every kind of trouble."""

import asyncio
import json
import shutil
import sqlite3
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from server.journal.entry import Entry, EntryKind
from server.journal.journal import JournalStatus, JournalUnavailable
from server.journal.store import Store, StoreUrlError
from tests.server.journal.keeping import (
    address,
    comment,
    event,
    full_disk,
    journal_at,
    verified,
)
from tests.server.waiting import eventually


def rows(folder: Path) -> list[tuple[str, str]]:
    connection = sqlite3.connect(folder / "journal.db")
    try:
        return connection.execute("SELECT kind, body FROM journal ORDER BY seq").fetchall()
    finally:
        connection.close()


@pytest.mark.asyncio
async def test_what_is_committed_is_on_the_disk_when_commit_returns(tmp_path: Path) -> None:
    async with journal_at(address(tmp_path)) as journal:
        sealed = await journal.commit(comment("Focus."))
        assert rows(tmp_path)[-1] == ("comment", '{"id":"c1","text":"Focus."}')
        assert (sealed.seq, sealed.author) == (2, "operator")  # after "started"


@pytest.mark.asyncio
async def test_entries_keep_their_order_and_the_chain_holds_over_restarts(tmp_path: Path) -> None:
    for run in range(3):
        async with journal_at(address(tmp_path)) as journal:
            for number in range(40):
                journal.post(event("ü\x00 🚀", number + 1, f"m{run}"))
    found = await verified(address(tmp_path))
    assert found.problems == ()
    assert found.entries == 3 * (40 + 2)
    async with journal_at(address(tmp_path)) as journal:
        page = await journal.page("m1", EntryKind.EVENT, 10, 5)
        assert [entry.number for entry in page] == [11, 12, 13, 14, 15]
        assert page[0].data == {"text": "ü\x00 🚀"}
        assert await journal.last_number("m1", EntryKind.EVENT) == 40
        assert await journal.last_number("m9", EntryKind.EVENT) == 0


@pytest.mark.asyncio
async def test_the_newest_checkpoint_is_kept(tmp_path: Path) -> None:
    async with journal_at(address(tmp_path)) as journal:
        for tick in range(100):
            journal.keep("m1", f'{{"tick":{tick}}}')
            await asyncio.sleep(0)
        await journal.commit(comment("now"))
        kept = await journal.checkpoint("m1")
        assert kept is not None
        assert kept["tick"] == 99
        assert "T" in kept["at"]
        assert await journal.checkpoint("m2") is None


@pytest.mark.asyncio
async def test_a_full_disk_refuses_commits_keeps_the_rest_and_heals(tmp_path: Path) -> None:
    told: list[JournalStatus] = []
    with capture_logs():
        async with journal_at(address(tmp_path)) as journal:
            journal.watch(told.append)
            await journal.commit(comment("before"))
            with full_disk():
                with pytest.raises(JournalUnavailable):
                    await journal.commit(comment("during"))
                await eventually(lambda: not journal.status.available)
                for number in range(1, 51):
                    journal.post(event(f"flying on {number}", number))
                with pytest.raises(JournalUnavailable):  # at once, without a wait
                    await asyncio.wait_for(journal.commit(comment("again")), 0.05)
                # While another attempt is made nothing waits; it fails and they wait again.
                await eventually(lambda: journal.status.waiting >= 50)
            await eventually(lambda: journal.status.available)
            await journal.commit(comment("after"))
            assert [status.available for status in told] == [False, True]
    bodies = [body for kind, body in rows(tmp_path) if kind in ("comment", "event")]
    assert len(bodies) == 52
    assert "before" in bodies[0]
    assert "after" in bodies[-1]
    assert not any("during" in body or "again" in body for body in bodies)
    assert (await verified(address(tmp_path))).problems == ()


@pytest.mark.asyncio
async def test_the_buffer_is_bounded_and_says_what_it_lost(tmp_path: Path) -> None:
    with capture_logs():
        async with journal_at(address(tmp_path), max_waiting=20) as journal:
            await journal.commit(comment("before"))
            with full_disk():
                journal.post(event("first", 1))
                await eventually(lambda: not journal.status.available)
                for number in range(2, 102):
                    journal.post(event("more", number))
                assert journal.status.waiting <= 21
                assert journal.status.lost == 80
            await eventually(lambda: journal.status.available)
    gaps = [body for kind, body in rows(tmp_path) if kind == "gap"]
    assert gaps == ['{"lost":80}']
    assert (await verified(address(tmp_path))).problems == ()


@pytest.mark.asyncio
async def test_an_entry_that_is_no_json_costs_no_other_one(tmp_path: Path) -> None:
    with capture_logs():
        async with journal_at(address(tmp_path)) as journal:
            await journal.commit(comment("before"))
            journal.post(Entry(EntryKind.EVENT, "m1", body={"x": float("nan")}))
            with pytest.raises(JournalUnavailable, match="JSON"):
                await journal.commit(Entry(EntryKind.COMMENT, "m1", body={"x": object()}))
            await journal.commit(comment("after"))
            assert journal.status.available
            assert journal.status.lost == 2
    told = rows(tmp_path)
    comments = [json.loads(body)["text"] for kind, body in told if kind == "comment"]
    assert comments == ["before", "after"]
    assert sum(json.loads(body)["lost"] for kind, body in told if kind == "gap") == 2
    assert (await verified(address(tmp_path))).problems == ()


@pytest.mark.asyncio
async def test_a_removed_file_is_noticed_and_the_gap_shows(tmp_path: Path) -> None:
    with capture_logs():
        async with journal_at(address(tmp_path)) as journal:
            await journal.commit(comment("one"))
            for name in ("journal.db", "journal.db-wal", "journal.db-shm"):
                (tmp_path / name).unlink()
            with pytest.raises(JournalUnavailable):
                await journal.commit(comment("two"))
            await eventually(lambda: journal.status.available)
            await journal.commit(comment("three"))
    found = await verified(address(tmp_path))
    assert found.problems[0] == "entry 1 to 2 are missing"


@pytest.mark.asyncio
async def test_a_folder_that_goes_and_comes_back(tmp_path: Path) -> None:
    """As a disk that is unmounted for a while: the same files are there again."""
    folder = tmp_path / "disk"
    with capture_logs():
        async with journal_at(address(folder)) as journal:
            await journal.commit(comment("one"))
            folder.rename(tmp_path / "gone")
            folder.write_text("in the way")
            with pytest.raises(JournalUnavailable):
                await journal.commit(comment("two"))
            journal.post(event("meanwhile"))
            await eventually(lambda: not journal.status.available)
            folder.unlink()
            (tmp_path / "gone").rename(folder)
            await eventually(lambda: journal.status.available)
            await journal.commit(comment("three"))
    texts = [body for kind, body in rows(folder) if kind in ("comment", "event")]
    assert len(texts) == 3
    assert (await verified(address(folder))).problems == ()


@pytest.mark.asyncio
async def test_one_journal_has_one_server(tmp_path: Path) -> None:
    async with journal_at(address(tmp_path)):
        with pytest.raises(JournalUnavailable, match="in use by another server"):
            async with journal_at(address(tmp_path)):
                pass
    async with journal_at(address(tmp_path)):
        pass


@pytest.mark.asyncio
async def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JournalUnavailable, match="cannot be opened"):
        async with journal_at(address(tmp_path / "file" / "below")):
            pass


@pytest.mark.parametrize(
    "url",
    [
        "",
        "journal.db",
        "mysql://u:secret-word@127.0.0.1/x",
        "sqlite://",
        "sqlite:///:memory:",
        "postgresql://u:secret-word@[::1/x",
    ],
)
def test_an_address_that_is_none_is_refused_without_its_password(url: str) -> None:
    with pytest.raises(StoreUrlError) as refused:
        Store(url)
    assert "secret-word" not in str(refused.value)


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        ("UPDATE journal SET body = replace(body, '20', '21') WHERE seq = 20", "entry 20 was"),
        ("UPDATE journal SET author = 'somebody' WHERE seq = 7", "entry 7 was changed"),
        ("UPDATE journal SET at = '2020' WHERE seq = 7", "entry 7 was changed"),
        ("DELETE FROM journal WHERE seq = 9", "entry 9 is missing"),
        ("DELETE FROM journal WHERE seq < 4", "entry 1 to 3 are missing"),
        (
            "UPDATE journal SET previous = (SELECT hash FROM journal WHERE seq = 3) WHERE seq = 5",
            "entry 5 does not follow entry 4",
        ),
        ("UPDATE checkpoints SET body = '{}'", "the checkpoint of mission m1 is damaged"),
    ],
)
async def test_every_kind_of_tampering_shows(tmp_path: Path, damage: str, problem: str) -> None:
    async with journal_at(address(tmp_path)) as journal:
        for number in range(1, 31):
            journal.post(event(f"event 20 {number}", number))
        journal.keep("m1", '{"tick":1}')
    assert (await verified(address(tmp_path))).problems == ()
    connection = sqlite3.connect(tmp_path / "journal.db")
    if "checkpoints" not in damage:
        with pytest.raises(sqlite3.IntegrityError, match="only ever added to"):
            connection.execute(damage)
    connection.executescript("DROP TRIGGER journal_no_update; DROP TRIGGER journal_no_delete")
    connection.execute(damage)
    connection.commit()
    connection.close()
    assert problem in (await verified(address(tmp_path))).problems[0]


@pytest.mark.asyncio
async def test_a_copy_of_the_files_made_at_any_moment_opens(tmp_path: Path) -> None:
    """What a kill -9 leaves: the write-ahead log beside a file without its last entries."""
    copies = []
    async with journal_at(address(tmp_path / "live")) as journal:
        for number in range(1, 41):
            await journal.commit(event("kept", number))
            if number % 10 == 0:
                copies.append((number, shutil.copytree(tmp_path / "live", tmp_path / str(number))))
    for number, folder in copies:
        async with journal_at(address(folder)) as journal:
            assert await journal.last_number("m1", EntryKind.EVENT) == number
        assert (await verified(address(folder))).problems == ()
