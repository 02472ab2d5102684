"""`startrack warm`: compile the kernels before they are needed."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from startrack.budget import analytic
from startrack.cli.earth import read_scene
from startrack.cli.options import Exit, describe
from startrack.cli.terminal import example, print_message, print_result, read_design, read_sequence
from startrack.core import FOLDERS, UNKEPT
from startrack.design import Case, Fidelity
from startrack.earth.geometry import observe_earth
from startrack.io import shipped
from startrack.sequence import run
from startrack.trial import run_random_trial

MB = 1e6  # byte


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack warm`."""
    describe(
        parser,
        "For containers, clusters and installations that are read-only later. Runs the example "
        "design once in every fidelity, in a sequence and through the analytic budget, so that "
        "numba compiles what they need. Compiled code is kept beside the package, or in the folder "
        "that NUMBA_CACHE_DIR names, and serves this kind of processor and these versions of "
        "Python, numba and NumPy; another machine compiles again. Kernels of other designs, such "
        "as line scanners, are compiled when they are first used.",
    )
    parser.add_argument(
        "--earth", action="store_true", help="also the kernels of Earth cameras (extra `earth`)"
    )


def command(options: argparse.Namespace) -> int:
    """Run each part once; the second run of the same command takes seconds."""
    began, jobs = time.perf_counter(), parts(read_design(example()).case)
    if options.earth:
        jobs["Earth geometry"] = earth_geometry
    for name, job in jobs.items():
        print_message(f"{name} ...")
        job()
    files = [file for folder in FOLDERS for file in Path(folder).glob("*.nbc")]
    result = {
        "seconds": time.perf_counter() - began,
        "files": len(files),
        "mb": sum(file.stat().st_size for file in files) / MB,
        "folders": len(FOLDERS),
        "not_kept": len(UNKEPT),
    }
    print_result(
        options,
        result,
        f"compiled in {result['seconds']:.0f} s; {len(files)} files of compiled code, "
        f"{result['mb']:.0f} MB",
    )
    return Exit.FAILED if UNKEPT else Exit.DONE


def parts(case: Case) -> dict[str, Callable[[], object]]:
    """What is run, by name."""
    sequence = read_sequence(shipped("sequences/slew.toml"))
    return {
        **{
            f"fidelity {fidelity}": partial(run_random_trial, case, 1, 0, fidelity)
            for fidelity in Fidelity
        },
        "sequence": partial(run, case, sequence, 1, 0),
        "analytic budget": partial(analytic, case),
    }


def earth_geometry() -> None:
    """The first lines of the example scene."""
    path = shipped("scenes/mountains.toml")
    next(iter(observe_earth(read_scene(path)[0], path.parent)))
