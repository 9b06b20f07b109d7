"""One sqlite3 file of a rosbag2 folder: its topics, and a topic's messages in batches.

A few pages that name each other as children are more rows than can ever be read, and a computed
column is as long as it likes: queries may take no more steps than the file's size makes plausible,
computed columns are refused, and messages longer than `MESSAGE_LIMIT` are none.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from imu_noise_id.errors import one_line

MESSAGE_LIMIT = 1 << 20
_BATCH = 2000
_STEPS_AT_ONCE = 100_000
_STEPS_PER_BYTE = 16
_TABLES = ("topics", "messages")
ERRORS = (sqlite3.Error, UnicodeDecodeError)
"""What reading a damaged database raises; the second where its error message is damaged too."""


@dataclass(frozen=True)
class SqliteTopic:
    """A row of the topics table; the definition is empty where the bag has none."""

    id: int
    name: str
    type: str
    serialization: str
    definition: str
    count: int


@contextmanager
def open_sqlite(path: Path) -> Iterator[sqlite3.Connection]:
    """Open read-only, running nothing that the file brings along.

    Raises
    ------
    sqlite3.Error, UnicodeDecodeError
        When it is no database, or none of rosbag2.
    """
    with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as database:
        database.text_factory = lambda text: text.decode(errors="replace")
        database.execute("PRAGMA trusted_schema=OFF")
        database.execute("PRAGMA cell_size_check=ON")
        _limit_steps(database, path.stat().st_size)
        tables = database.execute(
            "SELECT name FROM sqlite_master WHERE type='table' AND sql LIKE 'CREATE TABLE%'"
        )
        names = {row[0] for row in tables}
        if missing := set(_TABLES) - names:
            raise sqlite3.DatabaseError(f"it has no table {sorted(missing)[0]}")
        for table in _TABLES:
            if any(row[6] for row in database.execute(f"PRAGMA table_xinfo({table})")):
                raise sqlite3.DatabaseError(f"its table {table} has a computed column")
        yield database


def _limit_steps(database: sqlite3.Connection, size: int) -> None:
    """End a query that takes more steps than a file of this size can give work for."""
    left = 10 + _STEPS_PER_BYTE * size // _STEPS_AT_ONCE

    def stop() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    database.set_progress_handler(stop, _STEPS_AT_ONCE)


def topics(database: sqlite3.Connection) -> list[SqliteTopic]:
    """All topics with their message counts."""
    definitions: dict[str, str] = {}
    if database.execute("SELECT 1 FROM sqlite_master WHERE name='message_definitions'").fetchone():
        rows = database.execute(
            "SELECT topic_type, encoded_message_definition FROM message_definitions "
            "WHERE encoding='ros2msg'"
        )
        definitions = {kind: str(text) for kind, text in rows}
    counts = dict(database.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))
    rows = database.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id")
    return [
        SqliteTopic(
            topic_id,
            one_line(name),
            one_line(kind),
            one_line(serialization),
            definitions.get(kind, ""),
            counts.get(topic_id, 0),
        )
        for topic_id, name, kind, serialization in rows
        if isinstance(topic_id, int)
        and all(isinstance(t, str) for t in (name, kind, serialization))
    ]


def messages(
    database: sqlite3.Connection, topic_id: int, first_ns: int | None
) -> Iterator[tuple[list[int], list[bytes]]]:
    """Times of reception and bytes of a topic's messages, in batches, in the order received."""
    rows = database.execute(
        "SELECT timestamp, CASE WHEN length(data) > ? THEN x'' ELSE data END FROM messages "
        "WHERE topic_id=? AND timestamp>=? ORDER BY id",
        (MESSAGE_LIMIT, topic_id, first_ns if first_ns is not None else -(2**63)),
    )
    while batch := rows.fetchmany(_BATCH):
        whole = [row for row in batch if isinstance(row[0], int) and isinstance(row[1], bytes)]
        yield [row[0] for row in whole], [row[1] for row in whole]


def last_ns(database: sqlite3.Connection) -> int | None:
    """Time of reception of the last message."""
    row = database.execute("SELECT max(timestamp) FROM messages").fetchone()
    return int(row[0]) if row and row[0] is not None else None
