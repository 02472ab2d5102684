"""Run the trials that a store lacks, until a statistic is precise enough; watch the progress.

The bytes do not depend on interruptions.
"""

from __future__ import annotations

import json
import math
import re
import time
import traceback
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from startrack import core, metrics
from startrack.core import (
    Floats,
    Parameters,
    Range,
    Refused,
    Rows,
    arcsec,
    parameter,
    positive,
    whole,
)
from startrack.montecarlo.estimate import mean_square
from startrack.montecarlo.run import BLOCKS_PER_WORKER, blocks
from startrack.montecarlo.store import Store

STATISTICS = ("across", "about", "availability", "across-99.73")
GROWTH = 1.2, 4.0  # least and largest factor of trials from one test to the next; by hand


class Precision(Parameters):
    """The precision that a statistic is to reach.

    relative    1, half-width of its interval over its value, at most
    statistic   across, about: rms error per axis across, or about the boresight;
                across-99.73: the angle that 99.73 % of the errors across do not exceed, radial;
                availability: fraction of trials with a correct attitude
    confidence  1, of the interval
    sobol       whether trials lie at Sobol's points. The intervals of an rms then come from the
                scatter of their scrambles; the others assume random trials and are too wide
    limits      of a correct attitude, for the availability
    """

    relative: float = parameter(limit=Range(1e-6, 1))
    statistic: str = parameter(limit=Range(choices=STATISTICS), default="across")
    confidence: float = parameter(limit=Range(0.5, 0.9999), default=0.95)
    sobol: bool = False
    limits: metrics.ErrorLimits = metrics.STATED_ALONE

    def interval(self, outcomes: Rows) -> metrics.Interval:
        """The statistic of structured outcomes; errors over solved trials that are not false.

        An rms uses the controls of its trials, if they have any.
        """
        solved = outcomes[outcomes["solved"] & ~outcomes["false"]]
        if self.statistic == "availability":
            right = metrics.correct(outcomes, self.limits)
            return metrics.fraction_of_trials(right, outcomes, self.confidence)
        squares = solved["error_x"] ** 2 + solved["error_y"] ** 2
        if self.statistic == "across-99.73":
            unit = metrics.units_of(solved)
            number = None if unit is None else len(np.unique(unit))
            return quantile_interval(np.sqrt(squares), 0.9973, self.confidence, number)
        about = self.statistic == "about"
        if self.sobol or "surplus_across" in (outcomes.dtype.names or ()):
            return mean_square(outcomes, about, self.sobol).root(self.confidence)
        squares = solved["error_z"] ** 2 if about else squares / 2
        return metrics.rms_interval(metrics.independent(squares, solved), self.confidence)

    def reached(self, outcomes: Rows) -> bool:
        """Whether the interval is narrow enough."""
        return half_width(self.interval(outcomes)) <= self.relative

    def next_size(self, outcomes: Rows, trials: int) -> int:
        """Number of trials at the next test of the interval, after a test with the outcomes of
        `trials`.

        It depends only on outcomes, so that a campaign stops at the same trial with any
        interruptions. There are few tests, because each may stop too early by chance.
        """
        factor = (half_width(self.interval(outcomes)) / self.relative) ** 2
        factor = min(max(factor, GROWTH[0]), GROWTH[1]) if math.isfinite(factor) else GROWTH[1]
        return math.ceil(trials * factor)


def half_width(interval: metrics.Interval) -> float:
    """Half the width of an interval over its value; infinite where it is unbounded."""
    width = (interval.high - interval.low) / 2
    if not math.isfinite(width) or not interval.value > 0:
        return math.inf
    return width / interval.value


def quantile_interval(
    values: Floats, fraction: float, confidence: float = 0.95, number: int | None = None
) -> metrics.Interval:
    """A quantile of non-negative values, with the interval of `level_bounds`.

    fraction  in (0, 1)
    number    of independent groups of values; None: all values are independent
    Returns  the least value that this fraction does not exceed; its interval is unbounded above if
             there are too few values
    Accuracy  NaN without values. The coverage is at least the confidence.
    """
    if len(values) == 0:
        return metrics.Interval(math.nan, math.nan, math.nan)
    tail = (1 - confidence) / 2
    bounds = metrics.level_bounds(values, fraction, tail, tail, number)
    rank = max(math.ceil(len(values) * fraction), 1) - 1
    return metrics.Interval(float(np.partition(values, rank)[rank]), *bounds)


FIRST_TEST = 200  # trials, at the first test of the precision; chosen by hand
MOST_FAILURES = 10  # blocks
SECONDS = 1.0  # least time between two updates of a Watch
FRACTION = 0.01  # of the time, upper limit for its updates
# The line of a traceback that names the exception, in Python's format.
RAISED = re.compile(r"[A-Za-z_][\w.]*(Error|Exception|Executor|Warning|Pool)\b")


def resume(
    store: Store,
    executor: Executor,
    workers: int,
    trials: int,
    precision: Precision | None = None,
    seconds: float | None = None,
    progress: core.Advance | None = None,
    block: int | None = None,
    first: int = 0,
) -> Rows:
    """The outcomes of the first trials of a store, after running those that it lacks.

    trials     number of trials; with `precision` the largest number
    precision  stop at the first test that finds this precision. The numbers of trials at tests
               depend only on the outcomes.
    seconds    submit no block after this time; only this makes results depend on speed
    progress   called with the number of trials that were just done
    block      largest number of trials for a worker, and for a write; None: `Sampling.block`
    first      number of the first trial, without `precision`
    Returns    (n,) structured array in order of trial, without failed blocks
    Raises     ValueError if more than 10 blocks fail, or all; OSError if the disk is full.
    """
    whole(1, 10**9, trials=trials)
    block = store.sampling.block if block is None else block
    whole(1, 10**6, block=block)
    whole(0, 0 if precision else 2**62, first=first)
    if seconds is not None:
        positive(seconds=seconds)
    end = None if seconds is None else time.monotonic() + seconds  # no jumps of the clock
    size = min(FIRST_TEST, trials) if precision else trials
    while True:
        size_of_block = min(block, -(-size // (workers * BLOCKS_PER_WORKER)))
        lacking = missing(store.done(), first + size, size_of_block, first)
        plan = takewhile(lambda _: end is None or time.monotonic() < end, lacking)
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
    """Last message of a traceback: trial, kind of error and sentence, on one line.

    A refusal is its sentence alone.
    """
    lines = [line for line in report.splitlines() if line.strip()]
    notes = list[str]()
    while lines and lines[-1].startswith("in trial "):
        notes.insert(0, lines.pop())
    raised = [n for n, line in enumerate(lines) if RAISED.match(line)]
    words = " ".join(" ".join(lines[raised[-1] if raised else -1 :]).split())
    words = words.removeprefix(f"{Refused.__module__}.").removeprefix(f"{Refused.__name__}: ")
    return ", ".join((*notes, words)) if words or notes else "no words"


def _fill(
    store: Store,
    plan: Iterable[range],
    executor: Executor,
    workers: int,
    progress: core.Advance | None,
) -> None:
    done = blocks(store.case, store.seed, plan, executor, workers, make=store.sampling.trials)
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
    for numbers in [*done, range(trials, trials)]:
        stop = min(numbers.start, trials)
        while at < stop:
            cut = min(stop, (at // block + 1) * block)
            missing.append(range(at, cut))
            at = cut
        at = max(at, numbers.stop)
    return missing


class Watch:
    """Counts trials as they end, shows the statistic with its interval, and keeps a log.

    The log has one JSON object a line: seconds since the start, trials, trials_per_s, statistic,
    value, low, high (arcsec, or a fraction), confidence, relative_half_width, remaining_s. Numbers
    that are not yet known are null.
    """

    def __init__(
        self,
        store: Store,
        precision: Precision,
        most: int,
        show: Callable[[int, str], None],
        log: Path | None = None,
    ):
        """Begin to watch.

        precision  of which statistic; remaining_s is the time to reach it
        most       largest number of trials
        show       called with the number of trials that just ended, and a sentence or None
        log        file to append to; it is created if missing
        """
        self._store, self._precision, self._most, self._show = store, precision, most, show
        self._held = sum(len(block) for block in store.done())
        self._began = self._next = time.monotonic()
        if log:
            log.parent.mkdir(parents=True, exist_ok=True)
        self._log = log.open("a", encoding="utf-8") if log else None

    def __call__(self, trials: int) -> None:
        """Count trials that ended; failed trials are not in the store."""
        now = time.monotonic()
        if now < self._next:
            self._show(trials, "")
            return
        values = self.values()
        if self._log:
            self._log.write(json.dumps(values, allow_nan=False) + "\n")
            self._log.flush()
        self._show(trials, _sentence(values))
        self._next = now + max(SECONDS, (time.monotonic() - now) / FRACTION)

    def values(self) -> dict[str, Any]:
        """Progress and statistic at this time; None for unknown values."""
        seconds = time.monotonic() - self._began
        outcomes = self._store.outcomes()
        done = len(outcomes)
        rate = (done - self._held) / seconds if seconds > 0 else math.inf
        interval = self._precision.interval(outcomes)
        width = half_width(interval)
        unit = 1.0 if self._precision.statistic == "availability" else arcsec
        needed = done * (width / self._precision.relative) ** 2
        left = max(min(needed, self._most) - done, 0.0)
        values = {
            "seconds": seconds,
            "trials": done,
            "trials_per_s": rate,
            "statistic": self._precision.statistic,
            "value": interval.value / unit,
            "low": interval.low / unit,
            "high": interval.high / unit,
            "confidence": self._precision.confidence,
            "relative_half_width": width,
            "remaining_s": left / rate if rate else math.inf,
        }
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in values.items()
        }

    def close(self) -> None:
        """Log the end, and close."""
        if self._log:
            self._log.write(json.dumps(self.values(), allow_nan=False) + "\n")
            self._log.close()
            self._log = None

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _sentence(values: dict[str, Any]) -> str:
    value, low, high = (
        "?" if values[name] is None else f"{values[name]:.3f}" for name in ("value", "low", "high")
    )
    unit = "" if values["statistic"] == "availability" else " arcsec"
    rate = "" if values["trials_per_s"] is None else f"{values['trials_per_s']:.0f}/s, "
    return f"{rate}{values['statistic']} {value} [{low}, {high}]{unit}"
