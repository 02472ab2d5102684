"""Executors: this process, or a pool of others that is made again when one of them dies."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import Any

import cv2

from startrack.checks import whole


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

    def map(
        self,
        fn: Callable[..., Any],
        *iterables: Iterable[Any],
        timeout: float | None = None,
        chunksize: int = 1,
    ) -> Iterator[Any]:
        """Call when the result is asked for, so that whoever counts results sees them come."""
        return map(fn, *iterables)


class Lasting(Executor):
    """A pool of processes that outlives its workers.

    The standard pool is dead for good after one worker died. This one fails the calls that were
    under way, with BrokenExecutor, and takes new ones: the caller submits them again.
    """

    def __init__(self, workers: int):
        self._workers = workers
        self._pool = self._fresh()

    def _fresh(self) -> ProcessPoolExecutor:
        # A fresh interpreter: forks of a process with threads can hang.
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._workers, mp_context=context, initializer=_begin_worker)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call in one of the processes."""
        try:
            return self._pool.submit(fn, *args, **kwargs)
        except BrokenExecutor:
            self._pool.shutdown(wait=True)
            self._pool = self._fresh()
            return self._pool.submit(fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


@contextmanager
def pool(workers: int) -> Iterator[Executor]:
    """Workers on this machine: this process for one, a pool of new ones for more."""
    whole(1, 1024, workers=workers)
    one_thread()
    if workers == 1:
        yield Serial()
        return
    executor = Lasting(workers)
    try:
        yield executor
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def one_thread() -> None:
    """Let OpenCV use one thread: the workers share the machine between them."""
    cv2.setNumThreads(1)


def _begin_worker() -> None:
    one_thread()
    # Ctrl-C goes to all processes of the terminal; the master alone decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_master, daemon=True).start()


def _die_with_master() -> None:
    # Trap: the standard pool's workers wait for ever for calls of a master that was killed,
    # because they hold the writing end of their own queue open.
    master = multiprocessing.parent_process()
    if master is not None:
        wait([master.sentinel])
        os._exit(1)
