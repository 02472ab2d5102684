"""One SQLite file with the outcomes of all trials, so that no trial is repeated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from startrack.io import Database, FileKind
from startrack.montecarlo import checksum, impossible
from startrack.trial import OUTCOMES

LEDGER = FileKind(
    "ledger of startrack",
    0x53544C47,  # "STLG" in the file's header
    """
CREATE TABLE IF NOT EXISTS trials (
    key BLOB NOT NULL, first INTEGER NOT NULL, outcomes BLOB NOT NULL, PRIMARY KEY (key, first)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS stretches (
    key BLOB NOT NULL, number INTEGER NOT NULL, steps BLOB NOT NULL, PRIMARY KEY (key, number)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS checksums (
    key BLOB NOT NULL, first INTEGER NOT NULL, checksum BLOB NOT NULL, PRIMARY KEY (key, first)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS refused (key BLOB PRIMARY KEY, reason TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS forecasts (key BLOB PRIMARY KEY, found TEXT NOT NULL) WITHOUT ROWID;
""",
)


def fault_of(table: NDArray[np.void], data: bytes, known: bytes | None) -> str:
    """What is wrong with outcomes; empty where nothing is; known: None without a checksum."""
    if known is not None:
        return "" if checksum(data) == known else "their checksum is wrong"
    return impossible(table)


class Ledger:
    """Outcomes by key, open for one process at a time.

    Outcomes are committed before `keep` returns: the file stays valid when the process is killed.
    """

    def __init__(self, path: Path | None = None):
        """Open the ledger of a file, or make a new one; None keeps it in memory.

        Raises  ValueError where the file is no ledger, OSError where it cannot be opened or another
                process has it.
        """
        self.path = path
        self._database = Database(path, LEDGER)

    def held(self, key: bytes) -> NDArray[np.void]:
        """The outcomes kept under a key, in the order in which they came.

        Raises  ValueError where they are not as they were written.
        """
        rows = self._database.read(
            "SELECT first, outcomes, checksum FROM trials LEFT JOIN checksums USING (key, first) "
            "WHERE key = ? ORDER BY first",
            key,
        )
        done = 0
        for first, data, known in rows:
            length = len(data) if isinstance(data, bytes) else -1
            wrong = first != done or length <= 0 or length % OUTCOMES.itemsize
            if wrong or fault_of(np.frombuffer(data, OUTCOMES), data, known):
                raise ValueError(
                    f"{self.path} is damaged: trials of a design are not as they were written; "
                    "delete it, and the same command does its trials again"
                )
            done += length // OUTCOMES.itemsize
        return np.frombuffer(b"".join(row[1] for row in rows), OUTCOMES)

    def keep(self, key: bytes, first: int, outcomes: NDArray[np.void]) -> None:
        """Keep outcomes after the `first` ones that the key already has."""
        data = outcomes.tobytes()
        with self._database.transaction() as execute:
            execute("INSERT INTO trials VALUES (?, ?, ?)", (key, first, data))
            execute("INSERT INTO checksums VALUES (?, ?, ?)", (key, first, checksum(data)))

    def refusal(self, key: bytes) -> str:
        """Why the trials of a key cannot be run; empty where they can."""
        rows = self._database.read("SELECT reason FROM refused WHERE key = ?", key)
        return str(rows[0][0]) if rows else ""

    def keep_refusal(self, key: bytes, reason: str) -> None:
        """Keep the reason why the trials of a key cannot be run."""
        with self._database.transaction() as execute:
            execute("INSERT OR REPLACE INTO refused VALUES (?, ?)", (key, reason))

    def forecast(self, key: bytes) -> str:
        """What is expected of a design; empty where it is not known."""
        rows = self._database.read("SELECT found FROM forecasts WHERE key = ?", key)
        return str(rows[0][0]) if rows else ""

    def keep_forecast(self, key: bytes, found: str) -> None:
        """Keep what is expected of a design."""
        with self._database.transaction() as execute:
            execute("INSERT OR REPLACE INTO forecasts VALUES (?, ?)", (key, found))

    def stretch(self, key: bytes, number: int) -> bytes | None:
        """A stretch of a chain, None where it is not done yet."""
        query = "SELECT steps FROM stretches WHERE key = ? AND number = ?"
        rows = self._database.read(query, key, number)
        return rows[0][0] if rows else None

    def keep_stretch(self, key: bytes, number: int, steps: bytes) -> None:
        """Keep a stretch of a chain."""
        with self._database.transaction() as execute:
            execute("INSERT INTO stretches VALUES (?, ?, ?)", (key, number, steps))

    def close(self) -> None:
        """Merge the log into the file."""
        self._database.close()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
