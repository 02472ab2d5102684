"""Does startrack work with other people's code, clusters, images and hardware?

python experiments/ecosystem.py [--json FILE] [--only PART] [--trials 64] [--quick]

plugin_same         1, fraction of results that are equal to the results of one process, in two
                    processes and with Dask (if installed): bytes of trials, and the optimum and
                    fresh trials of `optimize`, for a design with a centroid, an identification and
                    a detector effect of an installed package
builtin_slowdown    1, CPU time of trials of a design without user code, over the CPU time of the
                    same trials with the hooks for user code removed: shortest of --turns
                    alternating runs; also the median of the pairs with its 95 % interval
keys_documented     1, fraction of keys of designs and missions with a meaning in the reference
wide_blind_solved   1, fraction of 25 photographs (half field some 30 degrees, distorted lens)
                    solved without a field of view
wide_blind_wrong    1, fraction of the solved photographs whose centre differs by more than 8 arcmin
                    from a reference with an accuracy of 5 arcmin
onboard_kb          kB of the guide catalogue for 15 degrees and magnitude 6, by onboard.py
onboard_same        1, fraction of 1,000 random skies on which its C reader and Python find the same
                    nearest star, cone and triangles
onboard_solved      1, fraction of 1,000 other skies whose stars the C reader identifies
hil_frames_per_s    1/s, rate of megapixel frames of a sequence that are rendered, searched, tracked
                    and written as FITS, raw or SER on two cores: twice the number per second of CPU
                    time of one process; the slowest format
hil_solved_by_peers 1, fraction of --frames frames of a slew of 0.3 deg/s, kept as 16-bit PNG, that
                    a peer solves within 60 arcsec of the table beside them; the lowest of the
                    available peers of hil_peers.py; there is also a figure for each peer
sketch_gb           GB, largest memory of a process that sketches --sketched trials and merges a
                    thousand sketches of a million trials each; it does not grow with the number of
                    trials. The merged sketches repeat the counts of the sketched trials: 1e9 trials
                    are not run
sketch_same         1, fraction of equal bytes: ten parts in two orders compared with the sketch of
                    all trials at once, and the thousand parts in two orders
A part without its data or packages is left out.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import dataclasses
import importlib
import io
import json
import math
import os
import random
import re
import resource
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from pathlib import Path
from typing import Any
from unittest import mock

import one_thread  # noqa: F401  # isort: skip
import command
from hil_peers import solved_by_peers
from onboard import AIM, figures
from scipy import stats

from startrack import Case, Fidelity, deg, load_design, run_trials, shipped
from startrack.cli import main as startrack
from startrack.core import code_of_command
from startrack.detection import CENTROIDS, DetectionPlan
from startrack.montecarlo import (
    Sampling,
    Serial,
    Sketch,
    dask_pool,
    load_sketch,
    merge_sketches,
    pool,
    resume_sketch,
    run,
    save_sketch,
)
from startrack.optimise import TrialRunner, optimize
from startrack.sequence import Leg, Recording, Sequence
from startrack.sequence import run as fly

PAGE = Path(__file__).parents[1] / "docs" / "extensions.md"
EXAMPLE = re.compile(r"in `(mylab/\w+\.py)`:\n\n```python\n(.*?)```", re.S)
POINTS = {
    "centroids": "mylab.centroids:snail",
    "identifications": "mylab.identifications:vote",
    "charge_effects": "mylab.effects:amplifier_glow",
}
CODE = (
    "tracker.detection.centroid=snail",
    "tracker.identification.method=vote",
    'instrument.detector.charge_effects=["amplifier_glow"]',
)
CAMPAIGN = (
    "campaign.fidelity=frame",
    "campaign.trials=8",
    "campaign.most_trials=16",
    "campaign.analytic_evaluations=12",
    "campaign.evaluations=12",
    "campaign.fresh_trials=16",
    'campaign.variables=[{name="instrument.detector.exposure", low="40 ms", high="200 ms"}, '
    '{name="tracker.detection.threshold", low=4.0, high=12.0}]',
)
EXAMPLE_DESIGN = "designs/noise_only.toml"
WRONG = 8.0  # arcmin
PERIOD, SLEW = 0.1, 0.3 * deg  # second and radian / second, of the frames for hardware in the loop
SEED = 3
DRAWN = 10  # parts of drawn trials
TIMED = 8  # trials of a timed run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=PARTS, help="the one part to run")
    parser.add_argument("--trials", type=int, default=64)
    parser.add_argument(
        "--turns",
        type=int,
        default=60,
        help="number of alternating runs of the timed trials (default: 60)",
    )
    parser.add_argument(
        "--sketched",
        type=int,
        default=200_000,
        help="number of trials in the sketch (default: 200000)",
    )
    parser.add_argument(
        "--frames", type=int, default=500, help="number of frames for other solvers (default: 500)"
    )
    options = command.read(parser, trials=2, turns=1, frames=3)
    figures: dict[str, Any] = {}
    for name, part in PARTS.items():
        if options.only in (None, name):
            figures |= part(options)
    for name, value in figures.items():
        print(f"{name:20s} {value:.4g}" if isinstance(value, float) else f"{name:20s} {value}")
    command.save(options, figures)


@contextlib.contextmanager
def examples_installed() -> Iterator[None]:
    """The examples of the page on user code, as a distribution with entry points."""
    with tempfile.TemporaryDirectory() as name, code_of_command(allow=False):
        folder, points = Path(name), ""
        (folder / "mylab").mkdir()
        (folder / "mylab" / "__init__.py").write_text("")
        for file, code in EXAMPLE.findall(PAGE.read_text(encoding="utf-8")):
            (folder / file).write_text(code, encoding="utf-8")
        for group, function in POINTS.items():
            points += f"[startrack.{group}]\n{function.partition(':')[2]} = {function}\n"
        about = folder / "mylab-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mylab\nVersion: 1.0\n")
        (about / "top_level.txt").write_text("mylab\n")
        (about / "entry_points.txt").write_text(points)
        sys.path.insert(0, name)
        importlib.invalidate_caches()
        try:
            yield
        finally:
            sys.path.remove(name)


def own_code(options: argparse.Namespace) -> dict[str, float]:
    """Trials and optimum in one process, in two processes, and with Dask."""
    with examples_installed():
        design = load_design(shipped(EXAMPLE_DESIGN), [*CODE, *CAMPAIGN], allow_code=True)
        case, campaign = design.case, design.campaign
        assert campaign

        def made(executor: Executor, workers: int) -> tuple[Any, ...]:
            trials = run(case, options.trials, SEED, executor, workers=workers).tobytes()
            if options.quick:  # tests/montecarlo/test_code.py optimises
                return (trials,)
            found = optimize(case, campaign, TrialRunner(SEED, executor, workers))
            return trials, found.best, found.fresh

        alone = made(Serial(), 1)
        # A process takes seconds to start.
        with contextlib.nullcontext(Serial()) if options.quick else pool(2) as executor:
            same = [one == other for one, other in zip(made(executor, 2), alone, strict=True)]
        if not options.quick and not command.missing("Dask", "distributed"):
            from distributed import LocalCluster

            with (
                LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
                dask_pool(cluster.scheduler_address) as executor,
            ):
                same += [one == other for one, other in zip(made(executor, 2), alone, strict=True)]
    return {"plugin_same": sum(same) / len(same)} | slowdown(options)


def slowdown(options: argparse.Namespace) -> dict[str, float]:
    """Trials, and the sending of their case, with and without the hooks for user code,
    alternately."""
    case = load_design(shipped(EXAMPLE_DESIGN)).case
    run_trials(case, SEED, range(2))
    took: dict[bool, list[float]] = {True: [], False: []}
    for turn in range(options.turns):
        for plain in (True, False) if turn % 2 else (False, True):
            with without_places_for_code() if plain else contextlib.nullcontext():
                took[plain].append(seconds(lambda: run_trials(copy.copy(case), SEED, range(TIMED))))
    ratios = sorted(a / b for a, b in zip(took[False], took[True], strict=True))
    # The true median is between these two in 95 % of all measurements.
    low = max(int(stats.binom.ppf(0.025, len(ratios), 0.5)) - 1, 0)
    return {
        "builtin_slowdown": min(took[False]) / min(took[True]),
        "builtin_slowdown_median": statistics.median(ratios),
        "builtin_slowdown_low": ratios[low],
        "builtin_slowdown_high": ratios[-1 - low],
    }


@contextlib.contextmanager
def without_places_for_code() -> Iterator[None]:
    """Remove two hooks of each frame: the name of the centroid, and the exchange of user code.

    Two hooks stay: the method of the identification, and effects by user code.
    """
    plain = property(lambda plan: CENTROIDS[plan.settings.centroid])
    with (
        mock.patch.object(DetectionPlan, "method", plain),
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
    """Memory and bytes of sketches: of drawn trials, as a whole and in parts, and of a thousand
    parts.

    The thousand parts have a million trials each, which were not run: they repeat the sums and
    counts of the drawn parts.
    """
    case, drawn = load_design(shipped(EXAMPLE_DESIGN)).case, Sampling(Fidelity.COVARIANCE)
    trials, parts = (400, 20) if options.quick else (options.sketched, 1000)
    size, million = trials // DRAWN, trials // DRAWN if options.quick else 10**6
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def made(file: str, numbers: range) -> Path:
            resume_sketch(folder / file, case, SEED, drawn, numbers, Serial())
            return folder / file

        def merged(files: list[Path], order: int) -> bytes:
            random.Random(order).shuffle(files)
            save_sketch(folder / "merged", merge_sketches(files))
            return (folder / "merged").read_bytes()

        whole = made("whole", range(DRAWN * size)).read_bytes()
        some = [made(f"{k}", range(k * size, (k + 1) * size)) for k in range(DRAWN)]
        same = [merged(some, order) == whole for order in range(2)]
        held, many = [load_sketch(one) for one in some], []
        for k in range(parts):
            many.append(folder / f"many{k}")
            save_sketch(many[-1], repeated(held[k % DRAWN], million // size, k))
        same.append(merged(many, 2) == merged(many, 3))
        found = load_sketch(folder / "merged")
        print(f"{found.trials:.3g} trials of {parts} parts: {found.rms('across')}", flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # KiB on Linux
    return {"sketch_gb": peak, "sketch_same": sum(same) / len(same)}


def repeated(sketch: Sketch, times: int, part: int) -> Sketch:
    """A part of a campaign made of repetitions of a sketch."""
    trials = sketch.trials * times
    return dataclasses.replace(
        sketch,
        ranges=[(part * trials, (part + 1) * trials)],
        counts={name: count * times for name, count in sketch.counts.items()},
        sums={name: total * times for name, total in sketch.sums.items()},
        bins={
            name: dataclasses.replace(one, count=one.count * times)
            for name, one in sketch.bins.items()
        },
    )


def documented(options: argparse.Namespace) -> dict[str, float]:
    """Keys of the reference whose meaning adds information to the key's name."""
    from startrack.design import design_keys

    meanings = rows_of("reference.md")
    missions = rows_of("mission-keys.md")
    keys = [key.name for key in design_keys() if "table" not in key.kind]
    told = sum(bool(said(meanings.get(name, ""), name)) for name in keys)
    told += sum(bool(said(text, name)) for name, text in missions.items())
    return {"keys_documented": told / (len(keys) + len(missions))}


def rows_of(page: str) -> dict[str, str]:
    """The meaning of each key of a page, by the key's path in a file."""
    found, table = {}, ""
    for line in (PAGE.parent / page).read_text(encoding="utf-8").splitlines():
        if heading := re.fullmatch(r"## `\[+([\w.]+)\]+`", line):
            table = f"{heading[1]}."
        if row := re.fullmatch(r"\| `(\w+)` \|.*\| (.*) \|", line):
            found[table + row[1]] = row[2]
    return found


def said(meaning: str, name: str) -> str:
    """A meaning; empty if it only repeats the name."""
    return "" if meaning.strip() == name.rpartition(".")[2].replace("_", " ") else meaning.strip()


def one_field(first: float = 0.0) -> list[float]:
    """The field of view of the photographs' lens, radian, in place of all fields of view."""
    return [0.83]


def wide_images(options: argparse.Namespace) -> dict[str, float]:
    """Photographs of a distorted wide lens, solved without a field of view."""
    folder = Path(os.environ.get("STARTRACK_DATA", "")) / "images-wide"
    if not (folder / "truth.json").is_file():
        print("wide images left out: STARTRACK_DATA names no folder with images-wide", flush=True)
        return {}
    truth = json.loads((folder / "truth.json").read_text())["images"]
    names = sorted(name for name in truth if (folder / name).is_file())
    if options.quick:  # one photograph, and one of the thirty fields of view: its lens's
        names = names[:1]
        command.shorten("startrack.identification.blind", fields=one_field)
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

    A quick run leaves this out: `onboard.py` makes the catalogue there.
    """
    if options.quick:
        return {}
    found = figures(*AIM, 1000)
    return {
        "onboard_kb": found["kb"],
        "onboard_same": found["same"],
        "onboard_solved": found["solved"],
    }


def hardware(options: argparse.Namespace) -> dict[str, Any]:
    """Rate of frames for hardware in the loop, and solutions of frames by other solvers."""
    size = 256 if options.quick else 1024
    changes = [f"instrument.detector.{side}={size}" for side in ("columns", "rows")]
    changes.append("instrument.detector.pixel_rate=40 Mpix / s")  # for ten frames a second
    case = load_design(shipped(EXAMPLE_DESIGN), changes).case

    def turning(frames: int) -> Sequence:
        return Sequence((Leg((frames + 0.5) * PERIOD, rate_x=SLEW),), period=PERIOD)

    rates = {}
    with tempfile.TemporaryDirectory() as folder:
        fly(case, turning(2), SEED, 0)  # compiles kernels and opens the data of all frames
        timed = turning(3 if options.quick else 100)
        for kind in ("fits", "ser", "raw"):
            began = time.process_time()
            table = fly(case, timed, SEED, 0, Recording(Path(folder) / kind, kind))
            rates[kind] = 2 * len(table) / (time.process_time() - began)
            print(f"{kind}: {rates[kind]:.1f} frames/s on two cores", flush=True)
            shutil.rmtree(Path(folder) / kind)
        fly(case, turning(options.frames), SEED, 0, Recording(Path(folder) / "png", "png"))
        solved = solved_by_peers(Path(folder) / "png", case)
    for name, fraction in solved.items():
        print(f"{name}: {fraction:.4f} of {options.frames} frames", flush=True)
    return {
        "hil_frames_per_s": min(rates.values()),
        "hil_solved_by_peers": min(solved.values(), default=None),
        **{f"hil_solved_by_{name}": fraction for name, fraction in solved.items()},
    }


PARTS: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
    "sketches": sketches,  # first, because it measures the memory of the process so far
    "code": own_code,
    "keys": documented,
    "images": wide_images,
    "onboard": onboard,
    "hardware": hardware,
}

if __name__ == "__main__":
    command.run(main)
