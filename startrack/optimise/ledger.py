"""One SQLite file with the outcomes of all trials, so that no trial is repeated."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Refused, Rows
from startrack.io import Database, FileKind
from startrack.trial import OUTCOMES

# "STLG" in the file's header. Files of format 0 had rows without a checksum.
LEDGER = FileKind("ledger of startrack", 0x53544C47, version=1)


REFUSED, FORECAST = b"refused", b"forecast"


class Ledger:
    """Outcomes by key, open for one process at a time.

    Outcomes are committed before `keep` returns: the file stays valid when the process is killed.
    """

    def __init__(self, path: Path | None = None):
        """Open the ledger of a file, or make a new one; None keeps it in memory.

        Raises  ValueError if the file is not a ledger, or of another format; OSError if it
                cannot be opened or another process uses it.
        """
        self.path = path
        self._database = Database(path, LEDGER)

    def held(self, key: bytes, columns: np.dtype[Any] = OUTCOMES) -> Rows:
        """The outcomes kept under a key, in the order in which they came.

        columns  names and types of one of them
        Raises  ValueError, with file and row, where they are not as they were written.
        """
        blocks, done = list[bytes](), 0
        for first, data in self._database.kept(key):
            if first != done:
                raise ValueError(
                    f"{self.path} is damaged: trial {done} of {key.hex()} is missing; delete it, "
                    "and the same command does its trials again"
                )
            blocks.append(data)
            done += len(data) // columns.itemsize
        return np.frombuffer(b"".join(blocks), columns)

    def keep(self, key: bytes, first: int, outcomes: Rows) -> None:
        """Keep outcomes after the `first` ones that the key already has."""
        self._database.keep(key, first, outcomes.tobytes())

    def completed(
        self,
        key: bytes,
        count: int,
        make: Callable[[int, int], Rows],
        columns: np.dtype[Any] = OUTCOMES,
    ) -> Rows:
        """The first `count` outcomes of a key; those that are not kept yet are made, and kept.

        make     outcomes of (first, number): from `first` on, as many
        columns  names and types of one of them
        Raises   Refused if `make` refuses, also on each later call; any other exception is a
                 fault and is not written to the ledger.
        """
        if reason := self.note(REFUSED, key):
            raise Refused(reason)
        stored = self.held(key, columns)
        lacking = count - len(stored)
        if lacking <= 0:
            return stored[:count]
        try:
            new = make(len(stored), lacking)
        except Refused as error:
            if error.lasting:
                self.keep_note(REFUSED, key, str(error))
            raise
        self.keep(key, len(stored), new)
        return np.concatenate([stored, new]).astype(columns)

    def note(self, kind: bytes, key: bytes) -> str:
        """The text of a kind that is kept under a key; empty where there is none.

        kind  REFUSED: why its trials cannot be run; FORECAST: expected figures of a design
        """
        return b"".join(data for _, data in self._database.kept(kind + key)).decode()

    def keep_note(self, kind: bytes, key: bytes, text: str) -> None:
        """Keep such a text."""
        self._database.keep(kind + key, 0, text.encode())

    def stretch(self, key: bytes, number: int) -> bytes | None:
        """A stretch of a chain, None where it is not done yet."""
        return dict(self._database.kept(key)).get(number)

    def keep_stretch(self, key: bytes, number: int, steps: bytes) -> None:
        """Keep a stretch of a chain."""
        self._database.keep(key, number, steps)

    def close(self) -> None:
        """Merge the log into the file."""
        self._database.close()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
