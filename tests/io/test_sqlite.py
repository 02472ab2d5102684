"""SQLite files from anybody: only their tables are read, no code of theirs runs, signals act."""

import os
import signal
import sqlite3
import threading
from contextlib import closing

import pytest

from startrack.io import Database, FileKind

KIND = FileKind("store of tests", 0x54455354, version=3)


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "a.sqlite"
    with closing(Database(file, KIND)) as database:
        database.keep(b"key", 1, b"data")
    return file


def reopened(path):
    with closing(Database(path, KIND, create=False)) as database:
        return database.kept(b"key")


def test_what_was_kept_is_read(path):
    assert reopened(path) == [(1, b"data")]


@pytest.mark.parametrize(
    ("statement", "words"),
    [
        ("CREATE VIEW extra AS SELECT 1", "the view 'extra'"),
        (
            "CREATE TRIGGER t AFTER INSERT ON rows BEGIN DELETE FROM rows; END",
            "the trigger 't' of another making",
        ),
        ("CREATE TABLE more (a INTEGER DEFAULT (abs(random())))", "the table 'more'"),
        ("CREATE INDEX i ON rows (length(data))", "the index 'i'"),
        (
            "DROP TABLE rows; CREATE VIEW rows AS SELECT x'6b6579' AS key, 1 AS number, x'' AS "
            "data, x'' AS checksum",
            "the view 'rows'",
        ),
    ],
)
def test_what_would_run_by_itself_is_refused(path, statement, words):
    with closing(sqlite3.connect(path)) as base:
        base.executescript(statement)
    with pytest.raises(ValueError, match=f"with its own tables alone, but has {words}"):
        reopened(path)


def test_a_signal_ends_a_long_query(path):
    """A count to 2e9 would take minutes. A process in the background may ignore the signal."""
    endless = (
        "WITH RECURSIVE c(x) AS (VALUES(1) UNION ALL SELECT x + 1 FROM c WHERE x < 2000000000) "
        "SELECT count(*) FROM c"
    )
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with closing(Database(path, KIND)) as database:
            alarm = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
            alarm.start()
            with pytest.raises(KeyboardInterrupt):
                database.read(endless)
            alarm.join()
    finally:
        signal.signal(signal.SIGINT, before)
