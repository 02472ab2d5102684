"""One SQLite file that holds a campaign: its case, seed, origin, and its blocks of trials."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import startrack
from startrack.core import whole
from startrack.design import Case, Fidelity
from startrack.io import Database, Execute, FileKind, from_table, save_csv, to_table
from startrack.io import whole as whole_file
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


STORE = FileKind(
    "campaign store",
    0x53545254,  # "STRT" in the file's header
    """
CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS sessions (began TEXT NOT NULL, origin TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS blocks (
    first INTEGER PRIMARY KEY, trials INTEGER NOT NULL, outcomes BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS failures (
    first INTEGER PRIMARY KEY, trials INTEGER NOT NULL, seed INTEGER NOT NULL, report TEXT NOT NULL
);
""",
    version=2,
)


class Store:
    """A campaign on disk, open for one process at a time.

    Each block is committed whole to a write-ahead log before the next: a process that is killed
    at any instant leaves a file with all blocks that it had kept. A loss of power may cost the last
    seconds, which are then repeated, never the file.

    case      of the trials
    seed      of all its random numbers
    sampling  of the trials
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

        Raises  ValueError where the file is no store, of another version, or holds another case
                or seed; OSError where it cannot be opened or another process has it.
        """
        self.path = path
        begin = None if case is None or seed is None else partial(_begin, case, seed, sampling)
        self._database = Database(path, STORE, begin is not None, begin)
        try:
            self._open(case, seed, sampling)
        except BaseException:
            self._database.close()
            raise

    def _open(self, case: Case | None, seed: int | None, sampling: Sampling) -> None:
        about = dict(self._database.read("SELECT name, value FROM about"))
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
            with self._database.transaction() as execute:
                execute("INSERT INTO sessions VALUES (?, ?)", session)

    def _must_match(self, case: Case, seed: int, sampling: Sampling) -> None:
        if seed != self.seed:
            raise ValueError(f"{self.path} holds trials of seed {self.seed}, not of seed {seed}")
        if sampling != self.sampling:
            raise ValueError(f"{self.path} holds trials of {self.sampling}, not of {sampling}")
        if (version := origin()["startrack"]) != self.startrack or self.dtype != sampling.dtype:
            raise ValueError(
                f"{self.path} holds trials of startrack {self.startrack}, which this startrack "
                f"{version} must not mix with others; begin another store"
            )
        held, asked = (json.loads(json.dumps(to_table(one))) for one in (self.case, case))
        other = _difference(held, asked)
        if other:
            raise ValueError(f"{self.path} holds trials of another design: {other}")

    @property
    def case(self) -> Case:
        """The case of the trials."""
        return from_table(Case, self._table)

    def keep(self, first: int, outcomes: NDArray[np.void]) -> None:
        """Commit a block of trials first, first + 1, ...; it may have failed before."""
        row = (first, len(outcomes), outcomes.tobytes())
        with self._database.transaction() as execute:
            execute("INSERT INTO blocks VALUES (?, ?, ?)", row)
            _forget_failures(execute, range(first, first + len(outcomes)))

    def keep_failure(self, numbers: range, report: str) -> None:
        """Commit that a block failed, and how; in place of what failed in it before."""
        row = (numbers.start, len(numbers), self.seed, report)
        with self._database.transaction() as execute:
            _forget_failures(execute, numbers)
            execute("INSERT INTO failures VALUES (?, ?, ?, ?)", row)

    def done(self) -> list[range]:
        """The trials that are kept, a range a block, in order."""
        rows = self._database.read("SELECT first, trials FROM blocks ORDER BY first")
        return [range(first, first + trials) for first, trials in rows]

    def failures(self) -> list[tuple[range, str]]:
        """The blocks that failed each time, with their tracebacks."""
        rows = self._database.read("SELECT first, trials, report FROM failures ORDER BY first")
        return [(range(first, first + trials), report) for first, trials, report in rows]

    def sessions(self) -> list[tuple[str, Mapping[str, str]]]:
        """When this store was worked on (UTC), and by which software and machine."""
        rows = self._database.read("SELECT began, origin FROM sessions ORDER BY rowid")
        return [(began, json.loads(text)) for began, text in rows]

    def outcomes(self, trials: int | None = None) -> NDArray[np.void]:
        """What is kept of the first `trials` trials (None: of all), in order of trial."""
        end = 2**63 - 1 if trials is None else trials
        rows = self._database.read(
            "SELECT outcomes FROM blocks WHERE first < ? ORDER BY first", end
        )
        table = np.frombuffer(b"".join(row[0] for row in rows), self.dtype)
        return table[: np.searchsorted(table["trial"], end)]

    def close(self) -> None:
        """Merge the log into the file."""
        self._database.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _begin(case: Case, seed: int, sampling: Sampling, execute: Execute) -> None:
    """The first rows of a store."""
    whole(0, 2**63 - 1, seed=seed)
    about = {
        "case": json.dumps(to_table(case), sort_keys=True),
        "seed": str(seed),
        "fidelity": sampling.fidelity.value,
        "attitudes": sampling.attitudes,
        "control": "yes" if sampling.control else "no",
        "fields": json.dumps(sampling.dtype.descr),
        "startrack": origin()["startrack"],
    }
    for row in about.items():
        execute("INSERT INTO about VALUES (?, ?)", row)


def _forget_failures(execute: Execute, numbers: range) -> None:
    # With another number of workers, blocks have other sizes: one may hold several that failed.
    execute(
        "DELETE FROM failures WHERE first < ? AND first + trials > ?",
        (numbers.stop, numbers.start),
    )


def _difference(held: Any, asked: Any, place: str = "") -> str:
    """Where two tables differ first, empty where they are equal."""
    if isinstance(held, dict) and isinstance(asked, dict):
        for key in sorted(held.keys() | asked.keys()):
            inner = f"{place}.{key}" if place else key
            if found := _difference(held.get(key), asked.get(key), inner):
                return found
        return ""
    return "" if held == asked else f"{place} is {held!r} there, {asked!r} here"


def export(path: Path, outcomes: NDArray[np.void]) -> None:
    """Write CSV or Parquet, as the name ends.

    Raises  ValueError for another ending; ImportError for Parquet without pyarrow.
    """
    if path.suffix == ".csv":
        save_csv(path, outcomes.dtype.names or (), (row.item() for row in outcomes))
    elif path.suffix == ".parquet":
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError:
            raise ImportError("Parquet needs pyarrow: python -m pip install pyarrow") from None
        names = outcomes.dtype.names or ()
        columns = {name: np.ascontiguousarray(outcomes[name]) for name in names}
        with whole_file(path) as draft:
            pyarrow.parquet.write_table(pyarrow.table(columns), draft)
    else:
        raise ValueError(f"the table's name must end in .csv or .parquet, got {path.name}")
