"""Does startrack work with what others have: their code, clusters, images, and hardware?

python experiments/ecosystem.py [--json FILE] [--only PART] [--trials 64] [--quick]

plugin_same         1, of the ways to run a design that names code of its own (two processes; Dask,
                    where it is installed), those whose trials have the same bytes as in one process
builtin_slowdown    1, CPU time of a trial of a design without such code over that of the same
                    trial without the places where code could be named; the median of neighbouring
                    pairs
keys_documented     1, of all keys of designs and missions, those with a meaning in the reference
wide_blind_solved   1, of 25 photographs (half field some 30 degrees, distorted lens), those solved
                    without a field of view
wide_blind_wrong    1, of these solved ones, those whose centre is more than 8 arcmin off a
                    reference that is good to 5
onboard_kb          kB of the guide catalogue for 15 degrees and magnitude 6, by onboard.py
onboard_same        1, of 1,000 random skies, those on which the C reader of it and Python find the
                    same nearest star, cone and triangles
onboard_solved      1, of other 1,000, those whose stars the C reader identifies
hil_frames_per_s    1/s, frames of a megapixel of a sequence that are rendered, searched, followed
                    and written as FITS, raw or SER on two cores: twice those of a second of CPU
                    time of one process; the slowest of the formats
hil_solved_by_peers 1, of the frames kept as 16-bit PNG, those that tetra3rs solves with its own
                    detection, within 60 arcsec of the table beside them; null without tetra3rs
sketch_gb           GB, largest memory of a process that sketches trials, which does not grow with
                    their number, and of the merging of a thousand sketches
sketch_same         1, of orders in which a thousand sketches were merged, those with the bytes of
                    the sketch of all trials at once
A part whose data or packages are not there is left out.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import csv
import importlib
import io
import json
import math
import os
import random
import re
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import one_thread  # noqa: F401  # isort: skip
import command
import cv2
import numpy as np
from onboard import AIM, figures
from scipy.spatial.transform import Rotation

from startrack import Case, Fidelity, arcsec, deg, load_design, run_trials, shipped
from startrack.cli.main import main as startrack
from startrack.core import code_of_command
from startrack.detection import DetectionPlan
from startrack.detection.methods import CENTROIDS
from startrack.montecarlo import (
    Sampling,
    Serial,
    dask_pool,
    merge_sketches,
    pool,
    resume_sketch,
    run,
    save_sketch,
)
from startrack.sequence import Leg, Recording, Sequence
from startrack.sequence import run as fly

PAGE = Path(__file__).parents[1] / "docs" / "extensions.md"
EXAMPLE = re.compile(r"in `(mylab/\w+\.py)`:\n\n```python\n(.*?)```", re.S)
CODE = (
    "tracker.detection.centroid=mylab.centroids:snail",
    "tracker.identification.method=mylab.identifications:vote",
    'instrument.detector.charge_effects=["mylab.effects:amplifier_glow"]',
)
EXAMPLE_DESIGN = "designs/noise_only.toml"
WRONG = 8.0  # arcmin
NEAR = 60 * arcsec
SEED = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=PARTS, help="one part alone")
    parser.add_argument("--trials", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=15, help="pairs of timed runs")
    parser.add_argument("--sketched", type=int, default=200_000, help="trials (default: 200000)")
    options = command.read(parser, trials=2, repeats=1)
    figures: dict[str, Any] = {}
    for name, part in PARTS.items():
        if options.only in (None, name):
            figures |= part(options)
    for name, value in figures.items():
        print(f"{name:20s} {value:.4g}" if isinstance(value, float) else f"{name:20s} {value}")
    command.save(options, figures)


@contextlib.contextmanager
def examples_installed() -> Iterator[None]:
    """The examples of the page on code of one's own, as a package that processes find."""
    with tempfile.TemporaryDirectory() as folder, code_of_command(allow=False):
        (Path(folder) / "mylab").mkdir()
        (Path(folder) / "mylab" / "__init__.py").write_text('__version__ = "1.0"\n')
        for name, code in EXAMPLE.findall(PAGE.read_text(encoding="utf-8")):
            (Path(folder) / name).write_text(code, encoding="utf-8")
        sys.path.insert(0, folder)
        importlib.invalidate_caches()
        try:
            yield
        finally:
            sys.path.remove(folder)


def own_code(options: argparse.Namespace) -> dict[str, float]:
    """The same trials in one process, in two, and with Dask."""
    with examples_installed():
        case = load_design(shipped(EXAMPLE_DESIGN), CODE, allow_code=True).case
        alone = run(case, options.trials, SEED, Serial()).tobytes()
        # A process takes seconds to begin.
        with contextlib.nullcontext(Serial()) if options.quick else pool(2) as executor:
            same = [run(case, options.trials, SEED, executor, workers=2).tobytes() == alone]
        if not options.quick and not command.missing("Dask", "distributed"):
            from distributed import LocalCluster

            with (
                LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
                dask_pool(cluster.scheduler_address) as executor,
            ):
                same.append(run(case, options.trials, SEED, executor, workers=2).tobytes() == alone)
    return {"plugin_same": sum(same) / len(same)} | slowdown(options)


def slowdown(options: argparse.Namespace) -> dict[str, float]:
    """Trials, and the sending of their case, with and without the places for code."""
    case = load_design(shipped(EXAMPLE_DESIGN)).case
    run_trials(case, SEED, range(2))

    def trials() -> None:
        run_trials(copy.copy(case), SEED, range(options.trials))

    ratios = []
    for repeat in range(options.repeats):
        took = {}
        for plain in (True, False) if repeat % 2 else (False, True):
            with without_places_for_code() if plain else contextlib.nullcontext():
                took[plain] = seconds(trials)
        ratios.append(took[False] / took[True])
    return {"builtin_slowdown": statistics.median(ratios)}


@contextlib.contextmanager
def without_places_for_code() -> Iterator[None]:
    """Take out what each frame asks: the centroid's name, effects of one's own, and the sending.

    The question for the method of the identification, one comparison of a frame, stays.
    """
    from startrack.detector import readout

    plain = property(lambda plan: CENTROIDS[plan.settings.centroid])
    with (
        mock.patch.object(DetectionPlan, "method", plain),
        mock.patch.object(readout, "after_effects", lambda group, names, values, *_: values),
        mock.patch.object(Case, "__getstate__", lambda case: case.__dict__.copy()),
        mock.patch.object(Case, "__setstate__", lambda case, state: case.__dict__.update(state)),
    ):
        yield


def seconds(call: Callable[[], Any]) -> float:
    """CPU time of a call."""
    began = time.process_time()
    call()
    return time.process_time() - began


def sketches(options: argparse.Namespace) -> dict[str, float]:
    """Memory and bytes of sketches of drawn trials, in one part and in a thousand."""
    case, drawn = load_design(shipped(EXAMPLE_DESIGN)).case, Sampling(Fidelity.COVARIANCE)
    trials, parts = (400, 20) if options.quick else (options.sketched, 1000)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def made(file: str, numbers: range) -> Path:
            resume_sketch(folder / file, case, SEED, drawn, numbers, Serial())
            return folder / file

        whole = made("whole", range(trials)).read_bytes()
        size = trials // parts
        files = [made(f"{k}", range(k * size, (k + 1) * size)) for k in range(parts)]
        same = []
        for order in range(3):
            random.Random(order).shuffle(files)
            save_sketch(folder / "merged", merge_sketches(files))
            same.append((folder / "merged").read_bytes() == whole)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # KiB on Linux
    return {"sketch_gb": peak, "sketch_same": sum(same) / len(same)}


def documented(options: argparse.Namespace) -> dict[str, float]:
    """Keys in the reference, with a meaning there that says more than the key itself."""
    from startrack.design.keys import design_keys

    meanings = rows_of("reference.md")
    missions = rows_of("mission-keys.md")
    keys = [key.name for key in design_keys() if "table" not in key.kind]
    told = sum(bool(said(meanings.get(name, ""), name)) for name in keys)
    told += sum(bool(said(text, name)) for name, text in missions.items())
    return {"keys_documented": told / (len(keys) + len(missions))}


def rows_of(page: str) -> dict[str, str]:
    """The meaning of each key of a page, by the key's place in a file."""
    found, table = {}, ""
    for line in (PAGE.parent / page).read_text(encoding="utf-8").splitlines():
        if heading := re.fullmatch(r"## `\[+([\w.]+)\]+`", line):
            table = f"{heading[1]}."
        if row := re.fullmatch(r"\| `(\w+)` \|.*\| (.*) \|", line):
            found[table + row[1]] = row[2]
    return found


def said(meaning: str, name: str) -> str:
    """A meaning; empty where it only repeats the name."""
    return "" if meaning.strip() == name.rpartition(".")[2].replace("_", " ") else meaning.strip()


def wide_images(options: argparse.Namespace) -> dict[str, float]:
    """Photographs of a distorted wide lens, solved without a field of view."""
    folder = Path(os.environ.get("STARTRACK_DATA", "")) / "images-wide"
    if not (folder / "truth.json").is_file():
        print("wide images left out: STARTRACK_DATA names no folder with images-wide", flush=True)
        return {}
    truth = json.loads((folder / "truth.json").read_text())["images"]
    names = sorted(name for name in truth if (folder / name).is_file())
    names = names[: 1 if options.quick else None]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        startrack(["solve", *(str(folder / name) for name in names), "--json"])
    found = [json.loads(line) for line in out.getvalue().splitlines()]
    solved = wrong = 0
    for one, true in zip(found, (truth[name] for name in names), strict=True):
        if one["status"] != "solved":
            continue
        solved += 1
        turn = (one["ra_deg"] - true["ra_deg"] + 180) % 360 - 180
        across = turn * math.cos(math.radians(true["dec_deg"]))
        wrong += 60 * math.hypot(across, one["dec_deg"] - true["dec_deg"]) > WRONG
    return {"wide_blind_solved": solved / len(names), "wide_blind_wrong": wrong / max(solved, 1)}


def onboard(options: argparse.Namespace) -> dict[str, float | None]:
    """The guide catalogue of 15 degrees and magnitude 6, and its reader in C.

    Not under --quick, where `onboard.py` makes it.
    """
    if options.quick:
        return {}
    found = figures(*AIM, 1000)
    return {
        "onboard_kb": found["kb"],
        "onboard_same": found["same"],
        "onboard_solved": found["solved"],
    }


def hardware(options: argparse.Namespace) -> dict[str, float | None]:
    """Frames in time for hardware in the loop, and what another solver makes of them."""
    size = 256 if options.quick else 1024
    sizes = [f"instrument.detector.{side}={size}" for side in ("columns", "rows")]
    case = load_design(shipped(EXAMPLE_DESIGN), sizes).case
    first = Sequence((Leg(0.5, rate_x=0.05 * deg),), period=0.25)
    sequence = first if options.quick else Sequence((Leg(6.0, rate_x=0.05 * deg),), period=0.25)
    rates = {}
    with tempfile.TemporaryDirectory() as folder:
        fly(case, first, SEED, 0)  # compiles and opens what all frames use
        for kind in ("fits", "ser", "raw"):
            began = time.process_time()
            table = fly(case, sequence, SEED, 0, Recording(Path(folder) / kind, kind))
            rates[kind] = 2 * len(table) / (time.process_time() - began)
            print(f"{kind}: {rates[kind]:.1f} frames/s on two cores", flush=True)
        fly(case, sequence, SEED, 0, Recording(Path(folder) / "png", "png"))
        solved = solved_by_tetra3rs(Path(folder) / "png", case)
    return {"hil_frames_per_s": min(rates.values()), "hil_solved_by_peers": solved}


def solved_by_tetra3rs(folder: Path, case: Case) -> float | None:
    """Fraction of the PNG files whose boresight tetra3rs finds within NEAR of their table."""
    if command.missing("frames solved by tetra3rs", "tetra3rs"):
        return None
    import tetra3rs

    camera = case.instrument.camera
    field = camera.fov_x / deg
    database = tetra3rs.SolverDatabase.generate_from_gaia(max_fov_deg=field, star_max_magnitude=7.0)
    with (folder / "sequence-0001.csv").open() as file:
        rows = list(csv.DictReader(file))
    solved = 0
    for row in rows:
        image = np.asarray(cv2.imread(str(folder / row["file"]), cv2.IMREAD_UNCHANGED))
        answer = database.solve_from_centroids(
            tetra3rs.extract_centroids(image, threads=1).centroids,
            fov_estimate_deg=field,
            fov_max_error_deg=0.05 * field,
            image_shape=image.shape,
        )
        if isinstance(answer, tetra3rs.SolveFailure):
            continue
        axis = np.array(answer.rotation_matrix_icrs_to_camera)[2]
        true = Rotation.from_quat([float(row[f"icrs_to_camera_{name}"]) for name in "xyzw"])
        solved += bool(np.linalg.norm(axis - true.as_matrix()[2]) < NEAR)
    return solved / len(rows)


PARTS: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
    "sketches": sketches,  # first, for it measures the memory of the process so far
    "code": own_code,
    "keys": documented,
    "images": wide_images,
    "onboard": onboard,
    "hardware": hardware,
}

if __name__ == "__main__":
    main()
