"""`startrack tools warm`: compile the kernels in advance."""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from startrack.cli.options import Exit, Option, Options, wanted

if wanted(__name__):
    import numpy as np
    from scipy.spatial.transform import Rotation

    from startrack.budget import analytic
    from startrack.cli import terminal
    from startrack.cli.beside import IDENTIFICATION, LOCK, TRIAL, start
    from startrack.core import READY, Spots, Streams, is_ready, kernel_folder, one_of
    from startrack.design import Case, Fidelity
    from startrack.detection import CENTROIDS, QUICK, detect
    from startrack.io import shipped
    from startrack.sequence import run
    from startrack.trial import identify_and_solve, observe, pattern_indexes, run_random_trial

MB = 1e6  # byte
# Parts that a second process compiles at the same time, on a second core.
SECOND_HALF = ("identification", "fidelity spots", "fidelity covariance", "sequence")
GARBAGE = 100_000  # objects between searches for cycles, which otherwise take 8 % of the time
SPOTS, SIGMA = 20, 0.1  # number of spots in the identified field, and noise in pixel


declare = Options(
    "For containers, clusters and later read-only installations. Runs the example design, and a "
    "design with a single PSF, in all fidelities, with all centroid methods, in a sequence and "
    "through the analytic budget, so that numba compiles their kernels, on two cores. Compiled "
    "code is cached beside the package, or in the folder NUMBA_CACHE_DIR, for this kind of "
    "processor and these versions of Python, numba and NumPy; another machine compiles again. "
    "Kernels of other designs, such as line scanners, are compiled at first use.",
    Option(
        "--part NAME",
        "one part alone, such as `identification`; may be given several times (default: all)",
        append=True,
    ),
    Option("--earth", "also compile the kernels of Earth cameras (extra `earth`)"),
)


def command(options: argparse.Namespace) -> int:
    """Run each part once; the second run of the same command takes seconds."""
    began, jobs = time.perf_counter(), parts(terminal.read_design(terminal.example()).case)
    if options.earth:
        jobs["Earth geometry"] = earth_geometry
    for part in options.part or ():
        one_of(jobs, part=part)
    if options.part:
        jobs = {part: jobs[part] for part in options.part}
    gc.set_threshold(GARBAGE)
    folder, other = kernel_folder(), None
    if folder and not options.part and not is_ready():
        other = start(SECOND_HALF, folder / LOCK)
    for name, job in jobs.items():
        if other and name == SECOND_HALF[0]:
            other.wait()  # its compiled code is loaded now
        terminal.print_message(f"{name} ...")
        job()
    if folder and {IDENTIFICATION, TRIAL} <= set(jobs):
        (folder / READY).touch()
    files = list(folder.rglob("*.nbc")) if folder else []
    result = {
        "seconds": time.perf_counter() - began,
        "files": len(files),
        "mb": sum(file.stat().st_size for file in files) / MB,
        "folders": int(folder is not None),
        "not_kept": int(folder is None),
    }
    size = f"{len(files)} files of compiled code, {result['mb']:.0f} MB"
    terminal.print_result(options, result, f"compiled in {result['seconds']:.0f} s; {size}")
    return Exit.DONE if folder else Exit.FAILED


def parts(case: Case) -> dict[str, Callable[[], object]]:
    """The parts to run, by name."""
    sequence = terminal.read_sequence(shipped("sequences/slew.toml"))
    plain = terminal.read_design(shipped("designs/noise_only.toml")).case

    def trial(design: Case, fidelity: Fidelity) -> Callable[[], object]:
        return partial(run_random_trial, design, 1, 0, fidelity)

    return {
        "fidelity frame": trial(case, Fidelity.FRAME),
        "fidelity window": trial(case, Fidelity.WINDOW),
        "analytic budget": partial(analytic, case),
        "one PSF": trial(plain, Fidelity.WINDOW),
        "identification": partial(identification, case),
        "fidelity spots": trial(plain, Fidelity.SPOTS),
        "fidelity covariance": trial(plain, Fidelity.COVARIANCE),
        "sequence": partial(run, case, sequence, 1, 0),
        "centroid methods": partial(centroids, plain),
    }


def centroids(case: Case) -> None:
    """Measure the stars of a frame by each centroid method and by the quick search."""
    settings = case.tracker.detection
    frame = observe(case, Rotation.identity(), Streams(1, 0)).frame
    others = [replace(settings, centroid=name) for name in CENTROIDS]
    for detection in (*others, replace(settings, search=QUICK)):
        detect(frame, detection)


def identification(case: Case) -> None:
    """Identify the brightest stars of a field where the tracker expects them, and solve."""
    camera, indexes = case.believed_camera, pattern_indexes(case.believed_catalog)
    ahead = indexes.stars.direction
    pixel = camera.project(ahead)
    star = np.flatnonzero((ahead[:, 2] > 0) & camera.holds(pixel))[:SPOTS]
    n, (x, y) = len(star), pixel[star].T.copy()
    flux = 10 ** (-0.4 * indexes.stars.magnitude_g[star])
    covariance = np.tile(np.eye(2) * SIGMA**2, (n, 1, 1))
    spots = Spots(x, y, flux, covariance, np.full(n, 50.0), np.full(n, 9))
    identify_and_solve(spots, camera, indexes, case.tracker)


def earth_geometry() -> None:
    """The first lines of the example scene."""
    # Imported here alone: the import would delay the other process.
    from startrack.cli.earth import read_scene
    from startrack.earth.geometry import observe_earth

    path = shipped("scenes/mountains.toml")
    next(iter(observe_earth(read_scene(path)[0], path.parent)))
