"""--workers, --scheduler and --tls -> the executor that trials run on."""

from __future__ import annotations

import argparse
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from pathlib import Path

from startrack.cli.imports import wanted
from startrack.cli.options import WrongUse, as_wrong_use

if wanted(__name__):
    from startrack.io import regular_file
    from startrack.montecarlo import Certificates, cluster, pool


def address(text: str) -> str:
    """Read the address of a scheduler."""
    if text != "mpi" and "://" not in text:
        raise argparse.ArgumentTypeError(f"must be tcp://host:port or mpi, got {text!r}")
    return text


def add_scheduler(parser: argparse.ArgumentParser) -> None:
    """Add the cluster that trials may run on instead of processes of this machine."""
    parser.add_argument(
        "--scheduler", type=address, metavar="ADDRESS",
        help="use the workers of a Dask cluster (tcp://host:port or tls://host:port) or of MPI "
        "(mpi)",
    )  # fmt: skip
    parser.add_argument(
        "--tls", type=Path, nargs=3, metavar=("CA", "CERT", "KEY"),
        help="files in PEM for tls://host:port: certificate of the authority, own certificate and "
        "own key",
    )  # fmt: skip


def open_workers(options: argparse.Namespace) -> AbstractContextManager[Executor]:
    """The executor of --workers or --scheduler, not yet open."""
    encrypted = (options.scheduler or "").startswith("tls://")
    if encrypted != bool(options.tls):
        raise WrongUse("--tls must be given with --scheduler tls://host:port, and with no other")
    if not options.scheduler:
        return pool(options.workers)
    with as_wrong_use(ValueError, OSError):
        files = [regular_file(path, "a file in PEM") for path in options.tls or ()]
    return cluster(options.scheduler, Certificates(*files) if files else None)
