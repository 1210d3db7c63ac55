"""The journal in PostgreSQL: a real server, started here, and ended under the writer."""

from collections.abc import Iterator

import pytest
from structlog.testing import capture_logs

from server.journal.entry import EntryKind
from server.journal.journal import JournalUnavailable
from server.journal.store import Store
from tests.server.journal.keeping import comment, event, journal_at, verified
from tests.server.journal.postgres import Postgres
from tests.server.waiting import eventually

pytestmark = [pytest.mark.process]


@pytest.fixture(scope="module")
def server() -> Iterator[Postgres]:
    postgres = Postgres()
    try:
        yield postgres.start()
    finally:
        postgres.remove()


@pytest.mark.asyncio
async def test_a_server_that_goes_and_comes_back(server: Postgres) -> None:
    with capture_logs():
        async with journal_at(server.url) as journal:
            sealed = await journal.commit(comment("before"))
            assert sealed.seq == 2
            with pytest.raises(JournalUnavailable, match="in use by another server"):
                async with journal_at(server.url):
                    pass
            server.stop()
            with pytest.raises(JournalUnavailable):
                await journal.commit(comment("during"))
            for number in range(1, 31):
                journal.post(event("\x00 ü flying on", number))
            journal.keep("m1", '{"tick":1}')
            await eventually(lambda: not journal.status.available)
            with pytest.raises(JournalUnavailable):
                await journal.read("m1", (EntryKind.COMMENT,))
            server.start()
            await eventually(lambda: journal.status.available)
            await journal.commit(comment("after"))
            said = await journal.read("m1", (EntryKind.COMMENT,))
            assert [entry.data["text"] for entry in said] == ["before", "after"]
            kept = await journal.checkpoint("m1")
            assert kept is not None
            assert kept["tick"] == 1
            page = await journal.page("m1", EntryKind.EVENT, 0, 100)
            assert [entry.number for entry in page] == list(range(1, 31))
    found = await verified(server.url)
    assert found.problems == ()
    assert found.entries == 34


@pytest.mark.asyncio
async def test_entries_cannot_be_changed_by_accident(server: Postgres) -> None:
    import asyncpg

    connection = await asyncpg.connect(server.url)
    try:
        for damage in ("UPDATE journal SET author = 'x'", "DELETE FROM journal"):
            with pytest.raises(asyncpg.PostgresError, match="only ever added to"):
                await connection.execute(damage)
    finally:
        await connection.close()


def test_a_password_is_not_told(server: Postgres) -> None:
    assert "unused-password" not in Store(server.url).where
