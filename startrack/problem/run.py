"""Problem and numbers -> rows of trials, the same for any number of workers."""

from concurrent.futures import Executor

import numpy as np

from startrack.core import Advance, Rows
from startrack.problem.problem import Problem

BLOCK = 64  # trials that a worker does at a time, at most; chosen by hand: progress against calls


def run_problem(
    problem: Problem,
    seed: int,
    numbers: range,
    executor: Executor | None = None,
    progress: Advance | None = None,
) -> Rows:
    """Rows (n,) of the trials of a problem.

    numbers   of the trials, without gaps
    executor  whose workers run blocks of them; None: this process
    progress  called with the number of trials that were just done
    Raises    the exceptions of a trial.
    """
    blocks = [
        range(first, min(first + BLOCK, numbers.stop))
        for first in range(numbers.start, numbers.stop, BLOCK)
    ]
    rows = list[Rows]()
    if executor is None:
        results = (problem.trials(seed, block) for block in blocks)
    else:
        futures = [executor.submit(problem.trials, seed, block) for block in blocks]
        results = (future.result() for future in futures)
    for block, some in zip(blocks, results, strict=True):
        rows.append(some)
        if progress:
            progress(len(block))
    return np.concatenate(rows) if rows else np.zeros(0, problem.columns)
