"""Stores of parts of a campaign -> one store, with the same bytes in any order of the parts."""

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from startrack.core import Advance, Refused, Rows, printed
from startrack.io import Database
from startrack.io import whole as whole_file
from startrack.montecarlo import store as stores
from startrack.montecarlo.run import require_whole, touching_runs
from startrack.montecarlo.store import STORE, Store
from startrack.population import AS_DESIGNED

BLOCK = AS_DESIGNED.block  # trials
WITHOUT_TRIALS = "campaign"  # row of `about` that does not affect trials


@printed
class Merged(NamedTuple):
    """Contents of a merged store.

    trials    number of different trials
    repeated  runs of trials that several parts have, with equal outcomes: first number, end number
    (exclusive)
    missing   runs of trials that no part has, likewise
    """

    trials: int
    repeated: tuple[tuple[int, int], ...]
    missing: tuple[tuple[int, int], ...] = ()


class _Part(NamedTuple):
    path: Path
    about: dict[str, str]
    sessions: list[tuple[str, str]]
    failures: list[Any]
    done: list[range]


def merge_stores(
    parts: list[Path],
    path: Path,
    progress: Advance | None = None,
    partial: bool = False,
    count: int | None = None,
) -> Merged:
    """Write one store of all trials of several.

    Blocks are cut again at multiples of BLOCK; sessions are in order of time.

    progress  called with the number of parts that were just read
    partial   whether trial numbers may be missing, before and between those of the parts
    count     number of trials of the campaign; None: the number in its parts
    Raises    ValueError, with the file, if a part is not a store, is of another campaign, or has a
              trial with an outcome other than another part's; Refused with the numbers of missing
              trials.
    """
    read = []
    for part in sorted(parts):
        read.append(_part(part))
        _must_belong(read[0], read[-1])
        if progress:
            progress(1)
    held = [(numbers.start, numbers.stop) for part in read for numbers in part.done]
    missing = require_whole(held, count, partial)
    with whole_file(path) as draft, closing(Database(draft, STORE)) as base:
        return _write(base, read)._replace(missing=missing)


def _part(path: Path) -> _Part:
    """Contents of a store, except its outcomes."""
    with Store(path) as store:  # which checks the file
        done = store.done()
        store.sessions()
        store.failures()
    with closing(Database(path, STORE, create=False)) as base:
        about = dict(base.read("SELECT name, value FROM about"))
        sessions = base.read("SELECT began, origin FROM sessions")
        failures = base.read("SELECT first, trials, seed, report FROM failures")
        return _Part(path, about, sessions, failures, done)


def _must_belong(first: _Part, other: _Part) -> None:
    for name in sorted(first.about.keys() | other.about.keys() - {WITHOUT_TRIALS}):
        stored, asked = other.about.get(name), first.about.get(name)
        if stored != asked and name != WITHOUT_TRIALS:
            if name in ("case", "code", "inputs") and stored and asked:
                where = stores.difference(json.loads(stored), json.loads(asked), name)
            else:
                where = f"{name} is {stored!r}, not {asked!r}"
            raise Refused(f"{other.path} is not of the campaign of {first.path}: {where}")


def _write(base: Database, parts: list[_Part]) -> Merged:
    about = dict(parts[0].about)
    asked = {part.about.get(WITHOUT_TRIALS) for part in parts}
    about.pop(WITHOUT_TRIALS, None)
    if len(asked) == 1 and (campaign := asked.pop()) is not None:
        about[WITHOUT_TRIALS] = campaign
    trials, repeated = 0, list[tuple[int, int]]()
    done = list[range]()
    with base.transaction() as execute:
        stores.write_about(execute, about)
        for session in sorted({session for part in parts for session in part.sessions}):
            stores.write_session(execute, session)
        for table in _blocks(parts, repeated):
            first, data = int(table["trial"][0]), table.tobytes()
            done.append(range(first, first + len(table)))
            trials += len(table)
            execute("INSERT INTO blocks VALUES (?, ?, ?)", (first, len(table), data))
            execute("INSERT INTO checksums VALUES (?, ?)", (first, stores.checksum(data)))
        for failure in sorted({tuple(failure) for part in parts for failure in part.failures}):
            # If several parts failed at the same trial, the report of the first part stays.
            if not any(numbers.start <= failure[0] < numbers.stop for numbers in done):
                stores.write_failure(execute, failure)
    return Merged(trials, tuple(touching_runs(repeated)))


def _blocks(parts: list[_Part], repeated: list[tuple[int, int]]) -> Iterator[Rows]:
    """All trials in order, in blocks that end at multiples of BLOCK or at a gap."""
    waiting: Rows | None = None
    for table in _runs(parts, repeated):
        if waiting is not None:
            if table["trial"][0] == waiting["trial"][-1] + 1:
                table = np.concatenate([waiting, table])
            else:
                yield waiting
        first = int(table["trial"][0])
        cuts = range((first // BLOCK + 1) * BLOCK - first, len(table) + 1, BLOCK)
        at = 0
        for cut in cuts:
            yield table[at:cut]
            at = cut
        waiting = table[at:] if at < len(table) else None
    if waiting is not None:
        yield waiting


def _runs(parts: list[_Part], repeated: list[tuple[int, int]]) -> Iterator[Rows]:
    """Outcomes of blocks in order of trial, without repeated trials."""
    order = sorted(
        (numbers.start, numbers.stop, n) for n, part in enumerate(parts) for numbers in part.done
    )
    before: Rows | None = None  # repeated trials are compared with these
    end, opened = 0, {}
    for first, stop, number in order:
        if number not in opened:
            with Store(parts[number].path) as store:
                opened[number] = store.outcomes()
        outcomes = opened[number]
        low, high = np.searchsorted(outcomes["trial"], [first, stop])
        table = outcomes[low:high]
        if stop == parts[number].done[-1].stop:
            del opened[number]
        if before is not None and first < end:
            again = min(end, stop)
            earlier = before[before["trial"] >= first]
            if table[: again - first].tobytes() != earlier[: again - first].tobytes():
                raise Refused(
                    f"{parts[number].path} has other outcomes of trials {first} to {again - 1} "
                    "than another part: one of them was made by other software"
                )
            repeated.append((first, again))
            table = table[again - first :]
        if len(table):
            overlap = before[before["trial"] >= first] if before is not None else table[:0]
            before = np.concatenate([overlap, table])
            end = stop
            yield table
