"""One SQLite file that remembers what was tried, so that no trial is done twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.io import connect, has_tables, log_ahead, translate_errors
from startrack.trial import OUTCOMES

WHAT = "ledger of startrack"
APPLICATION = 0x53544C47  # "STLG" in the file's header
TABLES = """
CREATE TABLE IF NOT EXISTS trials (
    key BLOB NOT NULL, first INTEGER NOT NULL, outcomes BLOB NOT NULL, PRIMARY KEY (key, first)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS stretches (
    key BLOB NOT NULL, number INTEGER NOT NULL, steps BLOB NOT NULL, PRIMARY KEY (key, number)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS refused (key BLOB PRIMARY KEY, reason TEXT NOT NULL) WITHOUT ROWID;
"""


class Ledger:
    """Outcomes by key, open for one process at a time.

    What is kept is committed before `keep` returns: a process that is killed at any instant
    leaves a whole file.
    """

    def __init__(self, path: Path | None = None):
        """Open the ledger of a file, or begin one; None keeps it in memory.

        Raises  ValueError where the file is none of ours, OSError where it cannot be opened or
                another process has it.
        """
        self.path = path
        with translate_errors(self.path, WHAT):
            if path:
                path.parent.mkdir(parents=True, exist_ok=True)
            self._base = connect(path)
            try:
                self._open()
            except BaseException:
                self._base.close()
                raise

    def _open(self) -> None:
        ask = self._base.execute
        has_tables(self._base, self.path, WHAT, APPLICATION)
        log_ahead(self._base)
        ask("BEGIN EXCLUSIVE")
        for statement in TABLES.split(";"):
            ask(statement)
        ask(f"PRAGMA application_id = {APPLICATION}")
        ask("COMMIT")

    def held(self, key: bytes) -> NDArray[np.void]:
        """The outcomes kept under a key, in the order in which they came."""
        rows = self._read("SELECT outcomes FROM trials WHERE key = ? ORDER BY first", key)
        return np.frombuffer(b"".join(row[0] for row in rows), OUTCOMES)

    def keep(self, key: bytes, first: int, outcomes: NDArray[np.void]) -> None:
        """Keep outcomes after the `first` ones that the key already has."""
        with translate_errors(self.path, WHAT):
            row = (key, first, outcomes.tobytes())
            self._base.execute("INSERT INTO trials VALUES (?, ?, ?)", row)

    def refusal(self, key: bytes) -> str:
        """Why what the key stands for cannot be tried; empty where it can."""
        rows = self._read("SELECT reason FROM refused WHERE key = ?", key)
        return rows[0][0] if rows else ""

    def keep_refusal(self, key: bytes, reason: str) -> None:
        """Keep that what the key stands for cannot be tried."""
        with translate_errors(self.path, WHAT):
            self._base.execute("INSERT OR REPLACE INTO refused VALUES (?, ?)", (key, reason))

    def stretch(self, key: bytes, number: int) -> bytes | None:
        """A stretch of a chain, None where it is not done yet."""
        query = "SELECT steps FROM stretches WHERE key = ? AND number = ?"
        rows = self._read(query, key, number)
        return rows[0][0] if rows else None

    def keep_stretch(self, key: bytes, number: int, steps: bytes) -> None:
        """Keep a stretch of a chain."""
        with translate_errors(self.path, WHAT):
            self._base.execute("INSERT INTO stretches VALUES (?, ?, ?)", (key, number, steps))

    def _read(self, query: str, *values: Any) -> list[Any]:
        """All rows; errors as when the ledger was opened."""
        with translate_errors(self.path, WHAT):
            return self._base.execute(query, values).fetchall()

    def close(self) -> None:
        """Fold the log into the one file."""
        self._base.close()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
