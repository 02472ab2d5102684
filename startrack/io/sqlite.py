"""SQLite file that one process holds at a time, and SQLite's errors in our words."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def connect(path: Path | None) -> sqlite3.Connection:
    """Open a file for this process alone; None keeps all in memory."""
    base = sqlite3.connect(path or ":memory:", timeout=0, isolation_level=None)
    # The lock is the system's, so that it ends with the process however that ends.
    base.execute("PRAGMA locking_mode = EXCLUSIVE")
    return base


def has_tables(base: sqlite3.Connection, path: Path | None, what: str, application: int) -> bool:
    """Whether a file was begun before, by whoever writes this application number.

    what    the file must be, as in "campaign store"
    Raises  ValueError where it holds another's tables.
    """
    if base.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone() is None:
        return False
    if base.execute("PRAGMA application_id").fetchone() != (application,):
        raise ValueError(f"{path} must be a {what}, but is another database")
    return True


def log_ahead(base: sqlite3.Connection) -> None:
    """Write to a log first, so that a process killed at any instant leaves a whole file."""
    base.execute("PRAGMA journal_mode = WAL")
    base.execute("PRAGMA synchronous = NORMAL")


@contextmanager
def translate_errors(path: Path | None, what: str) -> Iterator[None]:
    """Raise ValueError where the file is none or damaged, OSError where it cannot be used."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorname", "")
        if code.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
            raise OSError(f"{path} is in use by another process") from None
        if code.startswith("SQLITE_NOTADB"):
            raise ValueError(f"{path} must be a {what}, but is not one") from None
        if code.startswith("SQLITE_CORRUPT"):
            raise ValueError(f"{path} is damaged: {error}") from None
        raise OSError(f"{path} cannot be written: {error}; what it held is whole") from None
