"""One SQLite file that holds a campaign: its case, seed, origin, and each block of trials done."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import startrack
from startrack.core import whole
from startrack.design import Case, Fidelity
from startrack.io import connect, from_table, has_tables, log_ahead, to_table, translate_errors
from startrack.montecarlo.run import FRAMES
from startrack.montecarlo.sampling import Sampling

PACKAGES = ("numpy", "scipy", "numba", "astropy", "opencv-contrib-python-headless")


def origin() -> dict[str, str]:
    """Versions and machine, as text."""
    return {
        "startrack": startrack.__version__,
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
        "system": platform.platform(),
        "machine": platform.machine(),
        "processor": platform.processor(),
        "cores": str(os.cpu_count()),
    }


WHAT = "campaign store"
APPLICATION = 0x53545254  # "STRT" in the file's header
FORMAT = 2
TABLES = """
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE sessions (began TEXT NOT NULL, origin TEXT NOT NULL);
CREATE TABLE blocks (first INTEGER PRIMARY KEY, trials INTEGER NOT NULL, outcomes BLOB NOT NULL);
CREATE TABLE failures (first INTEGER PRIMARY KEY, trials INTEGER NOT NULL, seed INTEGER NOT NULL,
                       report TEXT NOT NULL);
"""


class Store:
    """A campaign on disk, open for one process at a time.

    Each block is committed whole to a write-ahead log before the next: a process that is killed
    at any instant leaves a file that holds all blocks it had kept. A loss of power may cost the
    last seconds, which are then done again, never the file.

    case      what was tried
    seed      of all its random numbers
    sampling  what a trial was
    """

    def __init__(
        self,
        path: Path | None,
        case: Case | None = None,
        seed: int | None = None,
        sampling: Sampling = FRAMES,
    ):
        """Open a store, or begin one.

        path  None keeps it in memory
        case  that it must hold; needed to begin one
        seed  likewise
        sampling  likewise, where the case is given

        Raises  ValueError where the file is none of ours, of another version, or holds another case
                or seed; OSError where it cannot be opened or another process has it.
        """
        self.path = path
        with translate_errors(self.path, WHAT):
            if path and case is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
            if path and case is None and not path.is_file():
                raise ValueError(f"{path} must be a campaign store, but there is none")
            self._base = connect(path)
            try:
                self._open(case, seed, sampling)
            except BaseException:
                self._base.close()
                raise

    def _open(self, case: Case | None, seed: int | None, sampling: Sampling) -> None:
        ask = self._base.execute
        begun = has_tables(self._base, self.path, WHAT, APPLICATION)
        if begun:
            self._must_be_of_this_format()
        elif case is None or seed is None:
            raise ValueError(f"{self.path} must be a campaign store, but is empty")
        log_ahead(self._base)
        ask("BEGIN EXCLUSIVE")
        if not begun and case is not None and seed is not None:
            whole(0, 2**63 - 1, seed=seed)
            self._begin(case, seed, sampling)
        about = dict(ask("SELECT name, value FROM about"))
        self.seed = int(about["seed"])
        # Stores from before there was a choice hold random attitudes without controls.
        self.sampling = Sampling(
            Fidelity(about["fidelity"]),
            about.get("attitudes", "random"),
            about.get("control", "no") == "yes",
        )
        self._table = json.loads(about["case"])
        self.dtype = np.dtype([(name, kind) for name, kind in json.loads(about["fields"])])
        self.startrack = about["startrack"]
        if case is not None:
            self._must_match(case, self.seed if seed is None else seed, sampling)
            session = (datetime.now(UTC).isoformat(timespec="seconds"), json.dumps(origin()))
            ask("INSERT INTO sessions VALUES (?, ?)", session)
        ask("COMMIT")

    def _begin(self, case: Case, seed: int, sampling: Sampling) -> None:
        for statement in TABLES.split(";"):
            self._base.execute(statement)
        about = {
            "case": json.dumps(to_table(case), sort_keys=True),
            "seed": str(seed),
            "fidelity": sampling.fidelity.value,
            "attitudes": sampling.attitudes,
            "control": "yes" if sampling.control else "no",
            "fields": json.dumps(sampling.dtype.descr),
            "startrack": origin()["startrack"],
        }
        self._base.executemany("INSERT INTO about VALUES (?, ?)", about.items())
        self._base.execute(f"PRAGMA application_id = {APPLICATION}")
        self._base.execute(f"PRAGMA user_version = {FORMAT}")

    def _must_be_of_this_format(self) -> None:
        (form,) = self._base.execute("PRAGMA user_version").fetchone()
        if form != FORMAT:
            raise ValueError(f"{self.path} must be a store of format {FORMAT}, got format {form}")

    def _must_match(self, case: Case, seed: int, sampling: Sampling) -> None:
        if seed != self.seed:
            raise ValueError(f"{self.path} holds trials of seed {self.seed}, not of seed {seed}")
        if sampling != self.sampling:
            raise ValueError(f"{self.path} holds trials of {self.sampling}, not of {sampling}")
        if (version := origin()["startrack"]) != self.startrack or self.dtype != sampling.dtype:
            raise ValueError(
                f"{self.path} holds trials of startrack {self.startrack}, which this startrack "
                f"{version} must not mix with its own; begin another store"
            )
        held, asked = (json.loads(json.dumps(to_table(one))) for one in (self.case, case))
        other = _difference(held, asked)
        if other:
            raise ValueError(f"{self.path} holds trials of another design: {other}")

    @property
    def case(self) -> Case:
        """What was tried."""
        return from_table(Case, self._table)

    def keep(self, first: int, outcomes: NDArray[np.void]) -> None:
        """Commit a block of trials first, first + 1, ...; it may have failed before."""
        with translate_errors(self.path, WHAT):
            self._base.execute("BEGIN")
            try:
                row = (first, len(outcomes), outcomes.tobytes())
                self._base.execute("INSERT INTO blocks VALUES (?, ?, ?)", row)
                self._forget_failures(range(first, first + len(outcomes)))
                self._base.execute("COMMIT")
            except BaseException:
                if self._base.in_transaction:
                    self._base.execute("ROLLBACK")
                raise

    def keep_failure(self, numbers: range, report: str) -> None:
        """Commit that a block failed, and how; in place of what failed in it before."""
        with translate_errors(self.path, WHAT):
            self._base.execute("BEGIN")
            self._forget_failures(numbers)
            row = (numbers.start, len(numbers), self.seed, report)
            self._base.execute("INSERT INTO failures VALUES (?, ?, ?, ?)", row)
            self._base.execute("COMMIT")

    def _forget_failures(self, numbers: range) -> None:
        # Blocks are cut anew for another number of workers: one may hold several that failed.
        self._base.execute(
            "DELETE FROM failures WHERE first < ? AND first + trials > ?",
            (numbers.stop, numbers.start),
        )

    def done(self) -> list[range]:
        """The trials that are kept, a range a block, in order."""
        rows = self._read("SELECT first, trials FROM blocks ORDER BY first")
        return [range(first, first + trials) for first, trials in rows]

    def failures(self) -> list[tuple[range, str]]:
        """The blocks that failed each time, with their tracebacks."""
        rows = self._read("SELECT first, trials, report FROM failures ORDER BY first")
        return [(range(first, first + trials), report) for first, trials, report in rows]

    def sessions(self) -> list[tuple[str, Mapping[str, str]]]:
        """When this store was worked on (UTC), and by which software and machine."""
        rows = self._read("SELECT began, origin FROM sessions ORDER BY rowid")
        return [(began, json.loads(text)) for began, text in rows]

    def outcomes(self, trials: int | None = None) -> NDArray[np.void]:
        """What is kept of the first `trials` trials (None: of all), in order of trial."""
        end = 2**63 - 1 if trials is None else trials
        rows = self._read("SELECT outcomes FROM blocks WHERE first < ? ORDER BY first", end)
        table = np.frombuffer(b"".join(row[0] for row in rows), self.dtype)
        return table[: np.searchsorted(table["trial"], end)]

    def _read(self, query: str, *values: Any) -> list[Any]:
        """All rows; errors as when the store was opened."""
        with translate_errors(self.path, WHAT):
            return self._base.execute(query, values).fetchall()

    def close(self) -> None:
        """Fold the log into the one file."""
        self._base.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _difference(held: Any, asked: Any, place: str = "") -> str:
    """Where two tables differ first, empty where they are equal."""
    if isinstance(held, dict) and isinstance(asked, dict):
        for key in sorted(held.keys() | asked.keys()):
            inner = f"{place}.{key}" if place else key
            if told := _difference(held.get(key), asked.get(key), inner):
                return told
        return ""
    return "" if held == asked else f"{place} is {held!r} there, {asked!r} here"
