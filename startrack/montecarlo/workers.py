"""Executors: this process, a pool of processes that survives crashes, Dask, MPI."""

import atexit
import gc
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from importlib import metadata
from multiprocessing.connection import wait
from multiprocessing.context import SpawnContext
from pathlib import Path
from typing import Any, NamedTuple

import cv2

from startrack.core import begin_limited, optional_package, software, whole


class Serial(Executor):
    """The executor of one worker: this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call at once; the result of the future raises the exception of the call."""
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
        """Call when the result is needed, so that a caller who counts results sees progress."""
        return map(fn, *iterables)


class Recorded(SpawnContext):
    """Starts processes, and records all of them.

    method  "spawn", with a fresh interpreter, because forks of a process with threads can hang; or
            another method of `multiprocessing`
    """

    def __init__(self, method: str = "spawn") -> None:
        super().__init__()
        self.method = method
        self.processes = list[Any]()

    def Process(self, *args: Any, **options: Any) -> Any:  # type: ignore[override]
        """A process that is not yet started."""
        process = multiprocessing.get_context(self.method).Process(*args, **options)  # type: ignore[attr-defined]
        self.processes.append(process)
        return process


class Lasting(Executor):
    """A pool of processes that outlives its workers.

    The standard pool is unusable after one worker died. This pool fails the running calls, with
    BrokenExecutor, and accepts new calls: the caller submits them again.
    """

    def __init__(self, workers: int):
        self._workers = workers
        self._broken = False
        self._pool = self._fresh()

    def _fresh(self) -> ProcessPoolExecutor:
        self._context = Recorded()
        return ProcessPoolExecutor(
            self._workers, mp_context=self._context, initializer=_begin_worker
        )

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call in one of the processes.

        Raises  OSError if no process can be started.
        """
        try:
            future = self._pool.submit(fn, *args, **kwargs)
        # Trap: a pool that breaks while it starts a process closes the descriptors of its queues,
        # and the pipe on which the process tells its number.
        except (BrokenExecutor, OSError, EOFError):
            self._end_broken()
            self._pool = self._fresh()
            future = self._pool.submit(fn, *args, **kwargs)
        future.add_done_callback(self._watch)
        return future

    def _watch(self, future: Future[Any]) -> None:
        if not future.cancelled() and isinstance(future.exception(), BrokenExecutor):
            self._broken = True

    def _end_broken(self) -> None:
        # Trap: the standard pool ends its processes when one dies, except a process that it starts
        # at the same time; it then waits for that process for ever.
        for process in self._context.processes:
            if process.pid is not None:
                process.kill()
        self._pool.shutdown(wait=True)
        self._broken = False

    def kill(self) -> None:
        """End the processes at once; results that were not returned are lost."""
        # Trap: the thread of Python 3.11's standard pool fails all calls of a broken pool, and
        # itself fails at a cancelled call. So cancelled calls are removed first.
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in self._context.processes:
            process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes."""
        if self._broken:
            self._end_broken()
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
    except KeyboardInterrupt:
        executor.kill()  # a block may take minutes
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def one_thread() -> None:
    """Let OpenCV use one thread: the workers already use all cores."""
    cv2.setNumThreads(1)


def _begin_worker() -> None:
    one_thread()
    begin_limited()
    # Otherwise Python searches all imported objects for garbage, repeatedly and at the end: 0.3 s.
    gc.freeze()
    atexit.register(gc.freeze)
    # Ctrl-C goes to all processes of the terminal; the main process alone handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_main, daemon=True).start()


def _end_with_main() -> None:
    # Trap: the standard pool's workers wait forever for calls of a main process that was killed,
    # because they hold the writing end of their own queue open.
    main = multiprocessing.parent_process()
    if main is not None:
        wait([main.sentinel])
        os._exit(1)


class Certificates(NamedTuple):
    """PEM files with which a Dask cluster is reached by TLS.

    authority    certificate of the authority that has signed those of all machines
    certificate  of this one
    key          private key of this one
    """

    authority: Path
    certificate: Path
    key: Path


def versions() -> dict[str, str]:
    """Versions that must agree on all machines, so that a trial has the same result on each."""
    packages = {name: metadata.version(name) for name in ("numba", "numpy")}
    return {"startrack": software()} | packages


def require_same_versions(workers: Mapping[str, Mapping[str, str]]) -> None:
    """Refuse workers of other versions.

    workers  the `versions` of each, by its name
    Raises   ValueError with the first that differs, and with both versions.
    """
    mine = versions()
    for name, theirs in workers.items():
        for package, version in mine.items():
            if (other := theirs.get(package, "none")) != version:
                raise ValueError(
                    f"worker {name} must have {package} {version}, as here, got {other}"
                )


@contextmanager
def cluster(address: str, certificates: Certificates | None = None) -> Iterator[Executor]:
    """The workers of a Dask scheduler (tcp://host:port, tls://host:port), or of MPI ("mpi")."""
    with mpi_pool() if address == "mpi" else dask_pool(address, certificates) as executor:
        yield executor


@contextmanager
def dask_pool(address: str, certificates: Certificates | None = None) -> Iterator[Executor]:
    """The workers of a Dask cluster, by the address of its scheduler (tcp://host:port).

    certificates  for tls://host:port, which encrypts, and admits only holders of a certificate

    Raises  ImportError without the extra `dask`; OSError if no scheduler answers; ValueError
            where a worker has another version of startrack, numba or NumPy.
    """
    needed = "--scheduler needs Dask: python -m pip install 'startrack[dask]'"
    distributed = optional_package("distributed", needed)
    security = None
    if certificates:
        security = distributed.Security(
            tls_ca_file=str(certificates.authority),
            tls_client_cert=str(certificates.certificate),
            tls_client_key=str(certificates.key),
            require_encryption=True,
        )
    with distributed.Client(address, security=security) as client:
        require_same_versions(client.run(versions))
        client.run(one_thread)
        # Trap: by default the executor assumes that calls are pure and merges equal ones.
        yield client.get_executor(pure=False)


@contextmanager
def mpi_pool() -> Iterator[Executor]:
    """The other processes of an MPI job, started as

        mpiexec -n 9 python -m mpi4py.futures -m startrack.cli montecarlo --scheduler mpi

    for one main process and eight workers.

    Raises  ImportError without mpi4py; ValueError if the job has no worker, or one of another
            version of startrack, numba or NumPy. A process that dies
            ends the whole job, as MPI does; the same command then continues from the store.
    """
    try:
        from mpi4py import MPI
        from mpi4py.futures import MPIPoolExecutor
    except (ImportError, RuntimeError) as error:  # a RuntimeError where no MPI library is found
        raise ImportError(
            "--scheduler mpi needs mpi4py and an MPI library: python -m pip install mpi4py "
            f"({error})"
        ) from None
    if MPI.COMM_WORLD.Get_size() < 2:
        raise ValueError(
            "--scheduler mpi needs workers; start it as: mpiexec -n 9 python -m mpi4py.futures "
            "-m startrack.cli montecarlo ..."
        )
    with MPIPoolExecutor(initializer=one_thread) as executor:
        # One call for each worker, though a worker may get two: all start from one command.
        calls = [executor.submit(versions) for _ in range(MPI.COMM_WORLD.Get_size() - 1)]
        require_same_versions({str(n + 1): call.result() for n, call in enumerate(calls)})
        yield executor
