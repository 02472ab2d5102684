"""One SQLite file that holds a campaign: its case, seed, origin, and its blocks of trials."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from startrack import core
from startrack.core import Rows, code_in, inputs_of, optional_package, origin_of, software, whole
from startrack.design import Campaign, Case, Fidelity
from startrack.io import Database, Execute, FileKind, from_table, save_csv, to_table
from startrack.io import whole as whole_file
from startrack.montecarlo.run import FRAMES
from startrack.montecarlo.sampling import Sampling
from startrack.population import stored_units
from startrack.trial import OUTCOMES

LARGEST_TRIAL = 1024  # byte
ABOUT = -1  # stands for a block in the table of checksums: the table `about`
SESSION = -(2**62)  # likewise: session n is at SESSION - n
FAILED = -2  # likewise: a failure from trial n is at FAILED - n
FULL = math.pi * (1 + 1e-9)  # radian
HUGE = 1e100
PACKAGES = ("numpy", "scipy", "numba", "astropy", "opencv-contrib-python-headless")


def origin() -> dict[str, str]:
    """Versions and machine, as text."""
    return {
        "startrack": software(),
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
CREATE TABLE IF NOT EXISTS checksums (
    first INTEGER PRIMARY KEY, checksum BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS failures (
    first INTEGER PRIMARY KEY, trials INTEGER NOT NULL, seed INTEGER NOT NULL, report TEXT NOT NULL
);
""",
    version=2,
)


class Store:
    """A campaign on disk, open for one process at a time.

    Each block is committed completely to a write-ahead log before the next. A process that is
    killed at any instant leaves a file with all committed blocks. A loss of power may lose the last
    seconds, which are then repeated, but never the file.

    case      of the trials
    seed      of all its random numbers
    sampling  of the trials
    code      that the case names, with the files with which the trials were begun
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

        Raises  ValueError if the file is not a store, is of another version, or has another case or
                seed; OSError if it cannot be opened or another process uses it.
        """
        self.path = path
        self._checked = set[Any]()
        begin = None if case is None or seed is None else partial(_begin, case, seed, sampling)
        self._database = Database(path, STORE, begin is not None, begin)
        try:
            self._open(case, seed, sampling)
        except BaseException:
            self._database.close()
            raise

    def _open(self, case: Case | None, seed: int | None, sampling: Sampling) -> None:
        with self._damage():
            about = self._about()
            self.seed = int(about["seed"])
            whole(0, 2**63 - 1, seed=self.seed)
            # Old stores without this choice hold random attitudes without controls.
            self.sampling = Sampling(
                Fidelity(about["fidelity"]),
                about.get("attitudes", "random"),
                about.get("control", "no") == "yes",
                stored_units(about),
            )
            self.dtype = np.dtype([(name, kind) for name, kind in json.loads(about["fields"])])
            self.startrack = about["startrack"]
            self.case: Case = from_table(Case, json.loads(about["case"]))
            held_code = json.loads(about.get("code", "[]"))
            self.code = tuple(core.Code(*map(str, text)) for text in held_code)
            # Stores without checksums are older than the requirement of one for each block.
            self._checksums = "inputs" in about
            self._inputs: dict[str, str] = json.loads(about.get("inputs", "{}"))
            if not set(OUTCOMES.names or ()) <= set(self.dtype.names or ()):
                raise ValueError("its trials lack fields")
            if self.dtype.hasobject or self.dtype.itemsize > LARGEST_TRIAL:
                raise ValueError("its trials are none")
            digest = self._sums().get(ABOUT)
            if digest is not None and digest != _checksum_of(sorted(about.items())):
                raise ValueError("what it says of its trials is not as it was written")
        if case is not None:
            self._must_match(case, self.seed if seed is None else seed, sampling)
            if any(key < SESSION for key in self._sums()):
                self.sessions()
            session = (datetime.now(UTC).isoformat(timespec="seconds"), json.dumps(origin()))
            with self._database.transaction() as execute:
                write_session(execute, session)

    @contextmanager
    def _damage(self) -> Iterator[None]:
        """Report unusable contents as damage, with the trials that can be saved."""
        try:
            yield
        except OSError:
            raise
        except (KeyError, ValueError, TypeError, AttributeError, RecursionError) as error:
            reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
            if str(self.path) in reason:
                raise ValueError(reason) from None
            raise ValueError(
                f"{self.path} is damaged, and none of its trials can be used: {reason}; begin "
                "another store"
            ) from None

    def _must_match(self, case: Case, seed: int, sampling: Sampling) -> None:
        if seed != self.seed:
            raise ValueError(f"{self.path} holds trials of seed {self.seed}, not of seed {seed}")
        if sampling != self.sampling:
            raise ValueError(f"{self.path} holds trials of {self.sampling}, not of {sampling}")
        if software() != self.startrack or self.dtype != sampling.dtype:
            raise ValueError(
                f"{self.path} holds trials of startrack {self.startrack}, which this startrack "
                f"{software()} must not mix with others; begin another store"
            )
        stored, asked = (json.loads(json.dumps(to_table(design))) for design in (self.case, case))
        if other := difference(stored, asked):
            raise ValueError(f"{self.path} holds trials of another design: {other}")
        self.require_inputs()

    def require_inputs(self) -> None:
        """Refuse to run trials with files or code other than those of the stored trials.

        Raises  ValueError if a file or code differs, or if code may not run.
        """
        before, now = self._inputs, inputs_of(self.case)
        for name in before.keys() | now.keys():
            if before.get(name) != now.get(name):
                old, new = (str(some.get(name))[:8] for some in (before, now))
                raise ValueError(
                    f"{self.path} holds trials with another content of {name}: digest {old}, not "
                    f"{new}; begin another store"
                )

    @property
    def campaign(self) -> Campaign | None:
        """The campaign as text; None if there is none."""
        table = self._database.read("SELECT value FROM about WHERE name = 'campaign'")
        with self._damage():
            return from_table(Campaign, json.loads(table[0][0])) if table else None

    def keep_campaign(self, campaign: Campaign) -> None:
        """Keep the campaign instead of an earlier one: it changes no trial."""
        row = {"campaign": json.dumps(to_table(campaign), sort_keys=True)}
        with self._database.transaction() as execute:
            write_about(execute, self._about() | row)

    def _about(self) -> dict[str, str]:
        return dict(self._database.read("SELECT name, value FROM about"))

    def keep(self, first: int, outcomes: Rows) -> None:
        """Commit a block of trials first, first + 1, ...; it may have failed before."""
        data = outcomes.tobytes()
        with self._database.transaction() as execute:
            execute("INSERT INTO blocks VALUES (?, ?, ?)", (first, len(outcomes), data))
            execute("INSERT INTO checksums VALUES (?, ?)", (first, checksum(data)))
            _forget_failures(execute, range(first, first + len(outcomes)))

    def keep_failure(self, numbers: range, report: str) -> None:
        """Commit that a block failed, with the report; it replaces earlier failures in this
        block."""
        row = (numbers.start, len(numbers), self.seed, report)
        with self._database.transaction() as execute:
            _forget_failures(execute, numbers)
            write_failure(execute, row)

    def done(self) -> list[range]:
        """The stored trials in order, one range for each block.

        Raises  ValueError if a block is damaged; as `outcomes`.
        """
        return [numbers for numbers, _ in self._blocks()]

    def failures(self) -> list[tuple[range, str]]:
        """The blocks that failed in all tries, with their tracebacks.

        Raises  ValueError if the record of a failure is damaged.
        """
        rows = self._database.read("SELECT first, trials, seed, report FROM failures")
        sums = self._sums() if rows and self._checksums else {}
        with self._damage():
            for row in rows if self._checksums else ():
                if sums.get(FAILED - int(row[0])) != _checksum_of(row):
                    raise ValueError(f"a failure at trial {row[0]!r:.40} is not as it was written")
            return [
                (range(int(first), int(first) + int(trials)), str(report))
                for first, trials, _, report in sorted(rows)
            ]

    def sessions(self) -> list[tuple[str, Mapping[str, str]]]:
        """Sessions of work on this store: times (UTC), software and machine."""
        query = "SELECT rowid, began, origin FROM sessions ORDER BY rowid"
        sums, made, rows = self._sums(), list[tuple[str, Mapping[str, str]]](), set[int]()
        with self._damage():
            for row, began, text in self._database.read(query):
                digest = sums.get(SESSION - row)  # None: written by an earlier version
                if digest is not None and digest != _checksum_of((began, text)):
                    raise ValueError(f"session {row} is not as it was written")
                origin = {str(name): str(value) for name, value in json.loads(text).items()}
                made.append((str(began), origin))
                rows.add(row)
            if lost := {SESSION - key for key in sums if key < SESSION} - rows:
                raise ValueError(f"session {min(lost)} is missing")
        if not made:
            raise ValueError(f"{self.path} is damaged: it lacks the session that began it")
        return made

    def outcomes(self, trials: int | None = None) -> Rows:
        """Outcomes of the first `trials` stored trials (None: of all), in order of trial.

        Raises  ValueError if a block is damaged: its checksum is wrong, or its content is no
                outcome of its trials. The message says how many of the other trials are valid.
        """
        end = 2**63 - 1 if trials is None else trials
        some = (data for numbers, data in self._blocks() if numbers.start < end)
        blocks = [np.frombuffer(data, self.dtype) for data in some]
        table = np.concatenate([np.empty(0, self.dtype), *blocks])
        return table[: np.searchsorted(table["trial"], end)]

    def _blocks(self) -> list[tuple[range, bytes]]:
        """The blocks in order, all checked; blocks that were checked before are not checked
        again."""
        rows = self._database.read("SELECT first, trials, outcomes FROM blocks ORDER BY first")
        sums: dict[Any, Any] | None = None
        blocks, damaged, last = list[tuple[range, bytes]](), list[Any](), 0
        for first, trials, data in rows:
            key = (first, trials, data if isinstance(data, str) else hash(data))
            if key not in self._checked:
                if sums is None:
                    sums = self._sums()
                digest = sums.get(first, b"" if self._checksums else None)
                if fault(first, trials, data, digest, self.dtype):
                    damaged.append(first)
                    continue
            if first < last:
                damaged.append(first)
                continue
            self._checked.add(key)
            last = first + trials
            blocks.append((range(first, last), data))
        if damaged:
            saved = sum(len(numbers) for numbers, _ in blocks)
            raise ValueError(
                f"{self.path} is damaged: {len(damaged)} of its {len(rows)} blocks of trials are "
                f"not as they were written, the first of them at trial {damaged[0]!r:.40}; {saved} "
                "trials are whole; begin another store, or delete those blocks with sqlite3"
            )
        return blocks

    def _sums(self) -> dict[Any, Any]:
        # Stores older than checksums lack the table if they are opened only to be read.
        if not self._database.read("SELECT 1 FROM sqlite_master WHERE name = 'checksums'"):
            return {}
        return dict(self._database.read("SELECT first, checksum FROM checksums"))

    def close(self) -> None:
        """Merge the log into the file."""
        self._database.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def checksum(data: bytes) -> bytes:
    """Checksum of the outcomes of a block."""
    return hashlib.blake2b(data, digest_size=8).digest()


def fault(first: Any, trials: Any, data: Any, expected: Any, dtype: np.dtype[Any]) -> str:
    """Fault in the outcomes of a block, in words; empty without a fault.

    expected  their checksum; None if the block was stored without one
    """
    if not all(isinstance(number, int) and 0 <= number < 2**62 for number in (first, trials)):
        return "its numbers are none"
    if not isinstance(data, bytes) or len(data) != trials * dtype.itemsize:
        return f"it holds no {trials} trials"
    table = np.frombuffer(data, dtype)
    if (table["trial"] != first + np.arange(len(table))).any():
        return "its trials have other numbers"
    if expected is not None:
        return "" if checksum(data) == expected else "its checksum is wrong"
    return impossible(table)


def impossible(table: Rows) -> str:
    """Impossible value of an outcome, in words; empty without one."""
    for name in ("solved", "false"):
        if (table[name].view(np.uint8) > 1).any():
            return f"{name} is neither true nor false"
    if (table["stars"] < 0).any() or (table["spots"] < 0).any():
        return "numbers of stars are negative"
    solved = table[table["solved"]]
    for name in (*(f"error_{axis}" for axis in "xyz"), *(f"sigma_{axis}" for axis in "xyz")):
        # A rotation vector is not longer than pi; a sigma of an attitude has no such bound.
        least, most = (-FULL, FULL) if name.startswith("error") else (0.0, HUGE)
        if not ((solved[name] >= least) & (solved[name] <= most)).all():
            return f"{name} is out of range"
    return "" if (solved["nees"] > -HUGE).all() and (solved["nees"] < HUGE).all() else "no nees"


def _begin(case: Case, seed: int, sampling: Sampling, execute: Execute) -> None:
    """The first rows of a store."""
    whole(0, 2**63 - 1, seed=seed)
    about = {
        "case": json.dumps(to_table(case), sort_keys=True),
        "inputs": json.dumps(inputs_of(case)),
        "seed": str(seed),
        "fidelity": sampling.fidelity.value,
        "attitudes": sampling.attitudes,
        "control": "yes" if sampling.control else "no",
        "fields": json.dumps(sampling.dtype.descr),
        "startrack": software(),
    }
    if code := [origin_of(key, name) for key, _, name in code_in(case)]:
        about["code"] = json.dumps(code)
    about |= sampling.units.stored
    write_about(execute, about)


def write_about(execute: Execute, about: Mapping[str, str]) -> None:
    """Write the description of a store's trials, with a checksum."""
    for row in about.items():
        execute("INSERT OR REPLACE INTO about VALUES (?, ?)", row)
    execute(
        "INSERT OR REPLACE INTO checksums VALUES (?, ?)",
        (ABOUT, _checksum_of(sorted(about.items()))),
    )


def _checksum_of(value: Sequence[Any]) -> bytes:
    return checksum(json.dumps(value).encode())


def write_session(execute: Execute, session: Sequence[Any]) -> None:
    """Write a session: time, software and machine, with a checksum."""
    row = execute("INSERT INTO sessions VALUES (?, ?)", session).lastrowid or 0
    execute("INSERT INTO checksums VALUES (?, ?)", (SESSION - row, _checksum_of(session)))


def write_failure(execute: Execute, row: Sequence[Any]) -> None:
    """Write a block that failed, with a checksum.

    row  first trial, trials, seed and report
    """
    execute("INSERT OR IGNORE INTO failures VALUES (?, ?, ?, ?)", row)
    values = (FAILED - row[0], _checksum_of(row))
    execute("INSERT OR IGNORE INTO checksums VALUES (?, ?)", values)


def _forget_failures(execute: Execute, numbers: range) -> None:
    # With another number of workers, blocks have other sizes: a block may include several failures.
    within = "DELETE FROM failures WHERE first < ? AND first + trials > ?"
    execute(within, (numbers.stop, numbers.start))
    execute(
        "DELETE FROM checksums WHERE first <= ? AND first > ? "
        "AND ? - first NOT IN (SELECT first FROM failures)",
        (FAILED, SESSION, FAILED),
    )


def difference(stored: Any, asked: Any, place: str = "") -> str:
    """First difference of a stored table from another; empty if they are equal."""
    if isinstance(stored, dict) and isinstance(asked, dict):
        for key in sorted(stored.keys() | asked.keys()):
            inner = f"{place}.{key}" if place else key
            if first := difference(stored.get(key), asked.get(key), inner):
                return first
        return ""
    return "" if stored == asked else f"{place} is {stored!r}, not {asked!r}"


def export(path: Path, outcomes: Rows) -> None:
    """Write CSV or Parquet, by the ending of the name.

    Raises  ValueError for another ending; ImportError for Parquet without pyarrow.
    """
    if path.suffix == ".csv":
        save_csv(path, outcomes.dtype.names or (), (row.item() for row in outcomes))
    elif path.suffix == ".parquet":
        needed = "Parquet needs pyarrow: python -m pip install pyarrow"
        pyarrow, parquet = (optional_package(n, needed) for n in ("pyarrow", "pyarrow.parquet"))
        names = outcomes.dtype.names or ()
        columns = {
            name: outcomes[name].tolist()
            if outcomes.dtype[name].kind == "U"
            else np.ascontiguousarray(outcomes[name])
            for name in names
        }
        with whole_file(path) as draft:
            parquet.write_table(pyarrow.table(columns), draft)
    else:
        raise ValueError(f"the table's name must end in .csv or .parquet, got {path.name}")
