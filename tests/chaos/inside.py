"""What is done to a journal from beside the server: `python -m tests.chaos.inside ACT ADDRESS`.

`drop` wants to know which comment, after the address.

A program of its own, because a small disk is seen by the processes of its own namespace alone.

    comments   print the comments in the database, text by id, as JSON
    lock       lock it, say so, and keep the lock until standard input ends
    tidy       move what waits beside a SQLite file into it, so that the next commit needs room
    edit       change one entry
    drop       remove the comment of an id, from the checkpoints as well
"""

import asyncio
import hashlib
import json
import sqlite3
import sys
from collections.abc import Callable, Coroutine
from typing import Any

from server.journal.entry import EntryKind
from server.journal.store import Store, parse_url
from server.journal.tables import ENTRIES

MOST = 100_000
COMMENT = EntryKind.COMMENT.value


async def comments(address: str) -> str:
    """Return the comments, text by id."""
    store = Store(address)
    await store.open_to_read()
    try:
        entries = await store.entries(ENTRIES.c.kind == COMMENT, limit=MOST)
    finally:
        await store.close()
    return json.dumps({str(e.data["id"]): str(e.data["text"]) for e in entries})


async def lock(address: str) -> str:
    """Hold the lock."""
    connection = _opened(address)
    connection.execute("BEGIN EXCLUSIVE")
    sys.stdout.write("locked\n")
    sys.stdout.flush()
    await asyncio.to_thread(sys.stdin.read)
    connection.close()
    return "free"


async def tidy(address: str) -> str:
    """Move what waits, as soon as nobody reads it."""
    connection, busy = _opened(address), 1
    while busy:
        (busy, *_) = connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    connection.close()
    return "tidy"


async def edit(address: str) -> str:
    """Change an entry, as somebody does who has the file."""
    connection = _opened(address)
    connection.execute("DROP TRIGGER journal_no_update")
    (seq,) = connection.execute("SELECT max(seq) / 2 FROM journal").fetchone()
    connection.execute("UPDATE journal SET author = 'somebody else' WHERE seq = ?", (seq,))
    connection.close()
    return str(seq)


async def drop(address: str, comment: str) -> str:
    """Remove a comment, as somebody does who has the file.

    The server knows what was said from its checkpoints as well: left in there it were not lost.
    """
    connection = _opened(address)
    connection.execute("DROP TRIGGER journal_no_delete")
    query = "DELETE FROM journal WHERE kind = ? AND json_extract(body, '$.id') = ?"
    gone = connection.execute(query, (COMMENT, comment)).rowcount
    for mission, body in connection.execute("SELECT mission, body FROM checkpoints").fetchall():
        bare = without(json.loads(body), comment)
        digest = hashlib.sha256(bare.encode()).hexdigest()
        change = "UPDATE checkpoints SET body = ?, digest = ? WHERE mission = ?"
        connection.execute(change, (bare, digest, mission))
    connection.close()
    assert gone == 1, f"{gone} comments have the id {comment}"
    return comment


def without(checkpoint: dict[str, Any], comment: str) -> str:
    """Return a checkpoint, as it is kept, without a comment."""
    core = json.loads(checkpoint["core"])
    for part in ("standing", "closed"):
        core[part] = [receipt for receipt in core[part] if receipt["comment"]["id"] != comment]
    return json.dumps(checkpoint | {"core": json.dumps(core)})


ACTS: dict[str, Callable[..., Coroutine[Any, Any, str]]] = {
    "comments": comments,
    "lock": lock,
    "tidy": tidy,
    "edit": edit,
    "drop": drop,
}


def _opened(address: str) -> sqlite3.Connection:
    database = parse_url(address).database
    assert database is not None
    return sqlite3.connect(database, timeout=20.0, isolation_level=None)


if __name__ == "__main__":
    sys.stdout.write(asyncio.run(ACTS[sys.argv[1]](*sys.argv[2:])) + "\n")
