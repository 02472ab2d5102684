"""Do the trials that a store lacks: the same bytes, however often it was interrupted."""

from __future__ import annotations

import re
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from startrack.core import Refused, positive, whole
from startrack.montecarlo.precision import Precision
from startrack.montecarlo.run import BLOCKS_PER_WORKER, blocks
from startrack.montecarlo.store import Store

FIRST_TEST = 200  # trials, at the first test of the precision; chosen by hand
MOST_FAILURES = 10  # blocks
# The line of a traceback that names what was raised, as those that Python writes.
RAISED = re.compile(r"[A-Za-z_][\w.]*(Error|Exception|Executor|Warning|Pool)\b")


def resume(
    store: Store,
    executor: Executor,
    workers: int,
    trials: int,
    precision: Precision | None = None,
    seconds: float | None = None,
    progress: Callable[[int], None] | None = None,
    block: int | None = None,
    first: int = 0,
) -> NDArray[np.void]:
    """The outcomes of the first trials of a store, after doing those that it lacks.

    trials     how many; with `precision` at most
    precision  stop at the first test that finds this precision. Tests are at numbers of trials
               that depend on the outcomes alone.
    seconds    submit no block after this time; only this makes results depend on speed
    progress   called with the number of trials that were just done
    block      trials that go to a worker and to disk at a time, at most; None: `Sampling.block`
    first      number of the first trial, without `precision`
    Returns    (n,) structured array in order of trial, without those of blocks that failed
    Raises     ValueError where more than 10 blocks fail, or all; OSError where the disk is full.
    """
    whole(1, 10**9, trials=trials)
    block = store.sampling.block if block is None else block
    whole(1, 10**6, block=block)
    whole(0, 0 if precision else 2**62, first=first)
    if seconds is not None:
        positive(seconds=seconds)
    end = None if seconds is None else time.monotonic() + seconds  # no clock jumps
    size = min(FIRST_TEST, trials) if precision else trials
    while True:
        each = min(block, -(-size // (workers * BLOCKS_PER_WORKER)))
        plan = _until(missing(store.done(), first + size, each, first), end)
        _fill(store, plan, executor, workers, progress)
        outcomes = store.outcomes(first + size)
        outcomes = outcomes[np.searchsorted(outcomes["trial"], first) :]
        if not len(outcomes) and (failures := store.failures()):
            raise Refused(f"all trials failed: {last_words(failures[-1][1])}")
        if precision is None or size == trials or precision.reached(outcomes):
            return outcomes
        if end is not None and time.monotonic() >= end:
            return outcomes
        size = min(precision.next_size(outcomes, size), trials)


def last_words(report: str) -> str:
    """What a traceback says in the end: trial, kind of error and sentence, on one line."""
    lines = [line for line in report.splitlines() if line.strip()]
    notes = list[str]()
    while lines and lines[-1].startswith("in trial "):
        notes.insert(0, lines.pop())
    raised = [n for n, line in enumerate(lines) if RAISED.match(line)]
    words = " ".join(" ".join(lines[raised[-1] if raised else -1 :]).split())
    return ", ".join((*notes, words)) if words or notes else "no words"


def _fill(
    store: Store,
    plan: Iterable[range],
    executor: Executor,
    workers: int,
    progress: Callable[[int], None] | None,
) -> None:
    done = blocks(store.case, store.seed, plan, executor, workers, sampling=store.sampling)
    for numbers, result in done:
        if isinstance(result, Exception):
            store.keep_failure(numbers, "".join(traceback.format_exception(result)))
            if len(store.failures()) > MOST_FAILURES:
                report = store.failures()[-1][1]
                raise Refused(
                    f"more than {MOST_FAILURES} blocks of trials failed, the last with: "
                    f"{last_words(report)}"
                ) from result
        else:
            store.keep(numbers.start, result)
        if progress:
            progress(len(numbers))


def missing(done: list[range], trials: int, block: int, first: int = 0) -> list[range]:
    """The trials from `first` to below `trials` that are not done, cut at multiples of `block`."""
    missing = []
    at = first
    for held in [*done, range(trials, trials)]:
        stop = min(held.start, trials)
        while at < stop:
            cut = min(stop, (at // block + 1) * block)
            missing.append(range(at, cut))
            at = cut
        at = max(at, held.stop)
    return missing


def _until(plan: Iterable[range], end: float | None) -> Iterator[range]:
    for numbers in plan:
        if end is not None and time.monotonic() >= end:
            return
        yield numbers
