"""Executors beyond one machine: Dask's and MPI's own."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from startrack.study.workers import one_thread


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """The workers of a Dask scheduler (tcp://host:port), or of MPI ("mpi")."""
    with mpi_pool() if address == "mpi" else dask_pool(address) as executor:
        yield executor


@contextmanager
def dask_pool(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster, by the address of its scheduler (tcp://host:port).

    Errors  ImportError without the extra `dask`; OSError where no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ImportError(
            "--scheduler needs Dask: python -m pip install 'startrack[dask]'"
        ) from None
    with Client(address) as client:
        client.run(one_thread)
        # Trap: by default the executor takes calls for pure and merges those that are alike.
        yield client.get_executor(pure=False)


@contextmanager
def mpi_pool() -> Iterator[Executor]:
    """The other processes of an MPI job, started as

        mpiexec -n 9 python -m mpi4py.futures -m startrack.cli montecarlo --scheduler mpi

    for one master and eight workers.

    Errors  ImportError without mpi4py; ValueError where the job has no worker. A process that
            dies ends the whole job, as MPI does; the same command then goes on from the store.
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
        yield executor
