"""Trials of a design, block by block, until they are stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Flags, Refused, Rows
from startrack.optimise import Ledger

MOST = 100_000


class Runner(NamedTuple):
    """Who computes trials, and what keeps them."""

    executor: Executor
    workers: int
    ledger: Ledger


class TrialColumns(NamedTuple):
    """Values (n,) of each trial by name and unit, the plotted ones first; and its success."""

    values: Mapping[str, NDArray[Any]]
    good: Flags


class TrialSource(NamedTuple):
    """Trials of a design.

    rows     function: number of trials -> their rows
    columns  function: rows -> values of each trial
    lines    function: all rows -> lines of a summary
    block    trials between checks for a stop
    """

    rows: Callable[[int], Rows]
    columns: Callable[[Rows], TrialColumns]
    lines: Callable[[Rows], list[str]]
    block: int


class TrialsRun:
    """Trials 0, 1, ... of one design at a time, the same trials that `startrack montecarlo` runs.

    A ledger in the folder keeps the trials, so that a run can continue.
    """

    def __init__(self, folder: Path, executor: Executor, workers: int) -> None:
        self._folder, self._executor, self._workers = folder, executor, workers
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._state: dict[str, Any] = {"count": 0}
        self._error = ""

    @property
    def running(self) -> bool:
        """Whether trials run."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, trials: int, source_of: Callable[[Runner], TrialSource]) -> None:
        """Begin trials, or continue trials with the same values."""
        if self.running:
            raise Refused("trials run already: stop them before others begin")
        if not 1 <= trials <= MOST:
            raise Refused(f"trials must be from 1 to {MOST}, got {trials}")
        source_of(Runner(self._executor, self._workers, Ledger()))  # refuses bad values here
        self._stop.clear()
        self._state, self._error = {"count": 0}, ""
        self._thread = threading.Thread(target=self._run, args=(trials, source_of), daemon=True)
        self._thread.start()

    def _run(self, trials: int, source_of: Callable[[Runner], TrialSource]) -> None:
        try:
            with np.errstate(all="ignore"), Ledger(self._folder / "trials.sqlite") as ledger:
                self._compute(source_of(Runner(self._executor, self._workers, ledger)), trials)
        except (ValueError, OSError) as reason:
            self._error = str(reason)

    def _compute(self, source: TrialSource, trials: int) -> None:
        columns, good = dict[str, list[float]](), list[bool]()
        while len(good) < trials and not self._stop.is_set():
            rows = source.rows(min(len(good) + source.block, trials))
            new = source.columns(rows[len(good) :])
            columns = {
                name: columns.get(name, []) + values.tolist() for name, values in new.values.items()
            }
            good = good + new.good.tolist()
            state = {"count": len(good), "columns": columns, "good": good}
            self._state = state | {"lines": source.lines(rows)}

    def stop(self) -> None:
        """End after the current block."""
        self._stop.set()
        if self._thread:
            self._thread.join()

    def state(self) -> dict[str, Any]:
        """Values of all trials so far, whether each succeeded, and the lines of a summary."""
        running = self.running  # before the last state is read
        return self._state | {"running": running, "message": self._error}
