"""Trials of a design, block by block, until they are stopped."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Refused, Rows, arcsec
from startrack.design import Fidelity
from startrack.metrics import correct, summarise, summary_rows, to_lines
from startrack.optimise import Ledger, TrialRunner
from startrack.page.tracker import TrackerPage

BLOCK = 4  # trials between checks for a stop; chosen by hand
MOST = 100_000


class TrialsRun:
    """Trials 0, 1, ... of one design at a time, the same trials that `startrack montecarlo` runs.

    A ledger in the folder keeps the trials, so that a run can continue.
    """

    def __init__(self, page: TrackerPage, folder: Path, executor: Executor, workers: int) -> None:
        self._page, self._folder = page, folder
        self._executor, self._workers = executor, workers
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._rows: Rows | None = None
        self._error = ""

    @property
    def running(self) -> bool:
        """Whether trials run."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, changes: Sequence[str], trials: int, fidelity: str) -> None:
        """Begin trials, or continue trials with the same values."""
        if self.running:
            raise Refused("trials run already: stop them before others begin")
        if not 1 <= trials <= MOST:
            raise Refused(f"trials must be from 1 to {MOST}, got {trials}")
        if fidelity not in [*Fidelity]:
            raise Refused(f"fidelity must be one of {', '.join(Fidelity)}, got {fidelity!r}")
        case = self._page.load(changes).case
        self._stop.clear()
        self._rows, self._error = None, ""

        def compute() -> None:
            try:
                with np.errstate(all="ignore"), Ledger(self._folder / "trials.sqlite") as ledger:
                    runner = TrialRunner(self._page.seed, self._executor, self._workers, ledger)
                    for count in range(BLOCK, trials + BLOCK, BLOCK):
                        self._rows = runner.run(case, min(count, trials), Fidelity(fidelity))
                        if self._stop.is_set():
                            break
            except (ValueError, OSError) as reason:
                self._error = str(reason)

        self._thread = threading.Thread(target=compute, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End after the current block."""
        self._stop.set()
        if self._thread:
            self._thread.join()

    def state(self) -> dict[str, Any]:
        """All trials so far: errors in arcsec, whether each is correct; the lines of a summary."""
        rows, state = self._rows, {"running": self.running, "message": self._error}
        if rows is None or not len(rows):
            return state | {"count": 0}
        radial = np.sqrt((rows["error_x"] ** 2 + rows["error_y"] ** 2) / 2)
        return state | {
            "count": len(rows),
            "across": (radial / arcsec).tolist(),
            "about": (np.abs(rows["error_z"]) / arcsec).tolist(),
            "stars": rows["stars"].tolist(),
            "correct": correct(rows).tolist(),
            "lines": to_lines(summary_rows(summarise(rows))),
        }
