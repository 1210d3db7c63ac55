"""The two tables: entries, only ever added to, and the newest checkpoint of each mission."""

from sqlalchemy import BigInteger, Column, Double, Index, MetaData, String, Table, Text

METADATA = MetaData()

ENTRIES = Table(
    "journal",
    METADATA,
    Column("seq", BigInteger, primary_key=True, autoincrement=False),
    Column("at", String(40), nullable=False),
    Column("mission", String(64), nullable=False),
    Column("number", BigInteger),
    Column("kind", String(32), nullable=False),
    Column("author", String(128), nullable=False),
    Column("time_s", Double),
    Column("body", Text, nullable=False),
    Column("previous", String(64), nullable=False),
    Column("hash", String(64), nullable=False),
    Index("journal_by_mission", "mission", "kind", "number"),
)

CHECKPOINTS = Table(
    "checkpoints",
    METADATA,
    Column("mission", String(64), primary_key=True),
    Column("at", String(40), nullable=False),
    Column("body", Text, nullable=False),
    Column("digest", String(64), nullable=False),
)
"""State, not history: each mission's row is replaced. The digest shows a row that was damaged."""
