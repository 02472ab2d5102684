"""Many trials of one case over a pool of workers: the same numbers for any number of them."""

from __future__ import annotations

import multiprocessing
import typing
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack.case import Case
from startrack.chain import trial
from startrack.checks import whole
from startrack.error import Outcome

OUTCOMES = np.dtype([("trial", np.int64), *typing.get_type_hints(Outcome).items()])
BLOCKS_PER_WORKER = 4  # so that no worker waits long for the last one


class Serial(Executor):
    """The executor of one worker: this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call at once; what the call raises comes out of the future's result."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def pool(workers: int) -> Iterator[Executor]:
    """Workers on this machine: this process for one, a pool of new ones for more."""
    whole(1, 1024, workers=workers)
    one_thread()
    if workers == 1:
        yield Serial()
        return
    # A fresh interpreter: forks of a process with threads can hang.
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=one_thread)
    try:
        yield executor
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def one_thread() -> None:
    """Let OpenCV use one thread: the workers share the machine between them."""
    cv2.setNumThreads(1)


def run(
    case: Case,
    trials: int,
    seed: int,
    executor: Executor,
    first: int = 0,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> NDArray[np.void]:
    """The outcomes of trials first ... first + trials - 1.

    progress  called with the number of trials that were just done
    Returns   (trials,) structured array: `trial` and the fields of Outcome, in order of trial
    Errors    what a trial raises, which a sky that cannot be solved does not.
    """
    whole(1, 10**9, trials=trials)
    numbers = np.arange(first, first + trials)
    blocks = np.array_split(numbers, min(trials, max(1, workers * BLOCKS_PER_WORKER)))
    futures = [executor.submit(_block, case, seed, block) for block in blocks]
    try:
        for future in as_completed(futures):
            if progress:
                progress(len(future.result()))
        return np.concatenate([future.result() for future in futures])
    finally:
        for future in futures:
            future.cancel()


def _block(case: Case, seed: int, numbers: NDArray[np.int64]) -> NDArray[np.void]:
    outcomes = np.empty(len(numbers), OUTCOMES)
    for i, number in enumerate(numbers):
        outcomes[i] = (number, *trial(case, seed, int(number)))
    return outcomes
