"""Many trials of one case over workers: the same numbers for any number of them."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from startrack.core import Advance, Refused, Rows, whole
from startrack.design import Case, Fidelity
from startrack.montecarlo.sampling import Sampling
from startrack.montecarlo.workers import Serial
from startrack.population import AS_DESIGNED, AsDesigned, Units
from startrack.trial import OUTCOMES

BLOCKS_PER_WORKER = 4  # so that workers end at about the same time; chosen by hand
UNDER_WAY = 3  # blocks per worker that are submitted ahead, so that none waits
FRAMES = Sampling()
TRIES = 3  # tries, after which a block is given up


class Block(NamedTuple):
    """A block of trials.

    numbers  the trials
    result   results of the trials in order, such as outcomes; or the error that the last try raised
    """

    numbers: range
    result: Any


def run(
    case: Case,
    trials: int,
    seed: int,
    executor: Executor,
    first: int = 0,
    workers: int = 1,
    progress: Advance | None = None,
    fidelity: Fidelity = Fidelity.FRAME,
    units: AsDesigned | Units = AS_DESIGNED,
) -> Rows:
    """The outcomes of trials first ... first + trials - 1.

    progress  called with the number of trials that just ended
    units     order of the trials over units; or the unit as designed for all
    Returns   (trials,) structured array: `trial` and the fields of Outcome, in order of trial
    Accuracy  raises the errors of a trial (an unsolved sky is none); BrokenExecutor if a block of
              trials kills its worker each time.
    """
    whole(1, 10**9, trials=trials)
    size = -(-trials // (workers * BLOCKS_PER_WORKER))
    size = -(-size // units.trials) * units.trials  # each unit is made once
    end = first + trials
    plan = [range(at, min(at + size, end)) for at in range(first, end, size)]
    outcomes = np.empty(trials, OUTCOMES)
    trials_of = Sampling(fidelity, units=units).trials
    for numbers, result in blocks(case, seed, plan, executor, workers, 1, trials_of):
        if isinstance(result, Exception):
            raise result
        outcomes[numbers.start - first : numbers.stop - first] = result[list(OUTCOMES.names or ())]
        if progress:
            progress(len(numbers))
    return outcomes


def warm(case: Case, sampling: Sampling = FRAMES) -> None:
    """Run a trial in this process: numba compiles kernels, which workers then load from its cache.

    Raises  Refused, ImportError, MemoryError or OSError, if no trial of the case can be run. Other
            errors may concern this trial alone, and are left to the trials.
    """
    # Plans at the nodes of units take minutes, in each worker.
    sampling = replace(sampling, units=sampling.units.anew)
    try:
        sampling.trials(case, 0, range(1))
    except (Refused, ImportError, MemoryError, OSError) as error:
        error.__notes__ = []  # notes name this trial, which is not in the campaign
        raise
    except Exception:
        return


def blocks(
    case: Case,
    seed: int,
    plan: Iterable[range],
    executor: Executor,
    workers: int = 1,
    tries: int = TRIES,
    make: Callable[[Case, int, range], Any] = FRAMES.trials,
) -> Iterator[Block]:
    """Blocks of trials as they end, in no order.

    A block whose worker died is repeated alone, because any of the running blocks may be the cause.
    A block that ends three workers when alone is given up. So is a block that raises an error in
    each of its `tries`.

    plan  ranges of numbers of trials, submitted one by one as workers become free
    make  function of a case and a range of trials -> result, such as outcomes
    """
    waiting = iter(plan)
    failed = dict[range, int]()  # number of failures of each
    again = deque[range]()
    suspects = deque[range]()
    futures = dict[Future[Any], range]()

    def submit(numbers: range) -> None:
        futures[executor.submit(make, case, seed, numbers)] = numbers

    try:
        while True:
            # A suspect runs alone, so that a worker that dies shows which block was the cause.
            if suspects and not futures:
                submit(suspects.popleft())
            while not suspects and len(futures) < workers * UNDER_WAY:
                numbers = again.popleft() if again else next(waiting, None)
                if numbers is None:
                    break
                submit(numbers)
                if isinstance(executor, Serial):
                    break
            if not futures:
                if suspects:
                    continue
                return
            alone = len(futures) == 1
            for future in wait(futures, return_when=FIRST_COMPLETED).done:
                numbers = futures.pop(future)
                error = future.exception()
                if error is None:
                    yield Block(numbers, future.result())
                    continue
                broken = isinstance(error, BrokenExecutor)
                failed[numbers] = failed.get(numbers, 0) + (alone or not broken)
                if failed[numbers] >= (TRIES if broken else tries):
                    # As an Exception, so that the main process goes on.
                    stopped = isinstance(error, Exception)
                    yield Block(numbers, error if stopped else RuntimeError(repr(error)))
                else:
                    (suspects if broken else again).append(numbers)
    finally:
        for future in futures:
            future.cancel()


def missing_runs(runs: list[tuple[int, int]], count: int | None = None) -> list[tuple[int, int]]:
    """Numbers from 0 on that no run has: first number, end number (exclusive).

    count  number of all trials; None: numbers after the last run are not counted
    """
    held = touching_runs(runs)
    ends = [0] + [end for _, end in held]
    begins = [first for first, _ in held]
    begins.append(max(count or 0, ends[-1]))
    return [(end, first) for end, first in zip(ends, begins, strict=True) if end < first]


def require_whole(
    runs: list[tuple[int, int]], count: int | None = None, partial: bool = False
) -> tuple[tuple[int, int], ...]:
    """The missing numbers, as `missing_runs`.

    partial  whether numbers may be missing
    Raises   Refused, with these numbers, if none may be missing; or if runs exceed the count
    """
    end = max((end for _, end in runs), default=0)
    if count is not None and count < end:
        raise Refused(
            f"trials of the whole campaign must be at least {end}, as the parts have trials up to "
            f"number {end - 1}, got {count}"
        )
    missing = missing_runs(runs, count)
    if missing and not partial:
        shown = ", ".join(f"{first} to {end - 1}" for first, end in missing[:9])
        more = f" and {len(missing) - 9} more runs" if len(missing) > 9 else ""
        raise Refused(
            f"parts must hold all trials from 0 on, but {shown}{more} are missing: add the parts "
            "that have them, or say that they may be missing (--partial)"
        )
    return tuple(missing)


def touching_runs(runs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Runs in order; touching or overlapping runs are joined."""
    merged: list[tuple[int, int]] = []
    for first, end in sorted(runs):
        if merged and first <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(end, merged[-1][1])
        else:
            merged.append((first, end))
    return merged
