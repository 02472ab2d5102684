"""How many trials of the complete chain does one core run, by fidelity, compared with other
programs?

python experiments/speed.py [--json FILE] [--picture FILE.png] [--quick]
python experiments/speed.py --against COMMIT [--json FILE] [--quick]

The example design on 1024 x 1024 pixels: from a random attitude to an error of the attitude. The
peers do the same work: GalSim draws the same stars as Gaussians of the same width on the same
background and adds the noise, tetra3rs finds the spots and solves them. CPU time, shortest of three
alternating repeats, one thread each.

With --against, CPU times of all stages of this tree and of a commit in alternating runs; a stage
that is slower by 10 % is marked, and the exit status is then 1. The times are appended to
`experiments/speed_history.csv`.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import command
import numpy as np
import speed_against

import one_thread  # noqa: F401  # isort: skip
from scipy.spatial.transform import Rotation

from startrack import (
    Case,
    Fidelity,
    Streams,
    arcsec,
    deg,
    load_design,
    random_attitude,
    run_trials,
    shipped,
)
from startrack.benchmark import studies
from startrack.catalog import open_sky
from startrack.detector import arriving
from startrack.metrics import summarise
from startrack.montecarlo import Sampling, pool, run, warm
from startrack.montecarlo import one_thread as one_opencv_thread
from startrack.observation import stars_in_field, throughput
from startrack.plots import CYCLE, MARKERS, legend_below, picture, save_picture, styled
from startrack.scene import illuminate

SEED = 5
REPEATS = 3
BATCH = {Fidelity.FRAME: 40, Fidelity.WINDOW: 160, Fidelity.SPOTS: 400, Fidelity.COVARIANCE: 4000}
PEER = 12  # trials trials of the peers
COLOURS = dict(zip(Fidelity, ("#3567a8", "#2e7d5b", "#8e6bbf", "#b5651d"), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--against", metavar="COMMIT", help="commit to measure alternately with this tree"
    )
    parser.add_argument("--picture", type=Path, help="file for the picture of speeds and scaling")
    options = command.read(parser)
    if options.against or options.quick:
        slower = in_turns(options)
        if options.against:
            raise SystemExit(int(slower))
    one_opencv_thread()
    case = load_design(shipped("designs/noise_only.toml")).case
    figures = speeds(studies.sized(case, 256 if options.quick else 1024), options.quick)
    if options.picture:
        figures["scaling"] = scaling(case, options.quick)
        draw(figures["scaling"], options.picture)
    command.save(options, figures)
    print(json.dumps({k: v for k, v in figures.items() if k != "scaling"}, indent=1))


def in_turns(options: argparse.Namespace) -> bool:
    """Print the table of stages. Returns whether a stage is slower."""
    if not speed_against.is_checkout():
        print("--against left out: this is no checkout of git")
        return False
    stages = speed_against.compare(options.against or "HEAD", options.quick)
    print(speed_against.table(stages, options.against or "HEAD"))
    if options.quick:
        return False
    if options.json:  # without the figures that are expected of this experiment
        options.json.write_text(json.dumps(stages, indent=1) + "\n", encoding="utf-8")
    speed_against.remember(stages, options.against)
    return any(row["ratio"] > speed_against.SLOWER for row in stages.values())


def speeds(case: Case, quick: bool) -> dict[str, Any]:
    """Trials per second of CPU, and the rms error, of each way."""
    repeats, peers = (1, 1) if quick else (REPEATS, PEER)
    ways: dict[str, tuple[int, Callable[[int], Any]]] = {}
    for fidelity in fidelities(case):
        n = 2 if quick else BATCH[fidelity]
        ways[fidelity.value] = (n, partial(some, case, fidelity, n))
    if one := peer(case):
        ways["galsim_tetra3"] = (
            peers,
            lambda at: np.array([one(n) for n in range(at, at + peers)]),
        )
    best: dict[str, float] = {}
    errors: dict[str, list[Any]] = {name: [] for name in ways}
    for _, call in ways.values():
        call(10**6)  # compiles and fills the caches
    for repeat in range(repeats):
        for name, (n, call) in ways.items():
            began = time.process_time()
            errors[name].append(call(repeat * n))
            best[name] = max(best.get(name, 0), n / (time.process_time() - began))
    figures: dict[str, Any] = {f"{name}_trials_per_s": rate for name, rate in best.items()}
    for name, found in errors.items():
        if name == "galsim_tetra3":
            angle = np.concatenate(found)
            figures[f"{name}_solved"] = float(np.isfinite(angle).mean())
            rms = math.sqrt(np.nanmean(np.where(angle < 0.5 * deg, angle, np.nan) ** 2) / 2)
        else:
            rms = summarise(np.concatenate(found)).across.value
        figures[f"{name}_across_rms_arcsec"] = rms / arcsec
    return figures


def some(case: Case, fidelity: Fidelity, n: int, first: int) -> Any:
    return run_trials(case, SEED, range(first, first + n), fidelity)


def fidelities(case: Case) -> list[Fidelity]:
    """Rates and errors of the fidelities."""
    made = []
    for fidelity in Fidelity:
        try:
            run_trials(case, SEED, range(1), fidelity)
        except ValueError as error:
            print(f"{fidelity}: {error}")
            continue
        made.append(fidelity)
    return made


def peer(case: Case) -> Callable[[int], float] | None:
    """Number of a trial -> error across of tetra3rs's solution of GalSim's image, radian."""
    if command.missing("GalSim and tetra3rs are", "galsim", "tetra3rs"):
        return None
    import galsim
    import tetra3rs

    instrument, camera = case.instrument, case.instrument.camera
    detector, sky = instrument.detector, open_sky(case.catalog)
    field = max(camera.fov_x, camera.fov_y) / deg
    base = tetra3rs.SolverDatabase.generate_from_gaia(
        max_fov_deg=field, star_max_magnitude=case.catalog.limit_g
    )
    # Blur and the core of the Airy disk, in pixels; stars move by a fraction of a pixel.
    sigma = math.hypot(instrument.optics.blur, 0.42 * 0.6e-6 * instrument.optics.f_number)
    profile = galsim.Gaussian(sigma=sigma / detector.pitch)

    def one(number: int) -> float:
        attitude = random_attitude(Streams(SEED, number))
        stars = stars_in_field(sky, attitude, camera)
        flux, level = arriving(
            illuminate(case.scene, stars), camera, detector, throughput(instrument)
        )
        pixel = camera.project(attitude.apply(stars.direction))
        inside = camera.holds(pixel, 4.0)
        image = galsim.ImageF(camera.columns, camera.rows, xmin=0, ymin=0)
        image.fill(level + detector.dark_rate * detector.exposure)
        for (x, y), electrons in zip(pixel[inside], flux[inside], strict=True):
            stamp = (profile * electrons).drawImage(
                nx=15, ny=15, scale=1.0, center=galsim.PositionD(x, y), dtype=np.float32
            )
            bounds = stamp.bounds & image.bounds
            if bounds.isDefined():
                image[bounds] += stamp[bounds]
        noise = galsim.CCDNoise(galsim.BaseDeviate(number + 1), gain=1.0, read_noise=detector.noise)
        image.addNoise(noise)
        numbers = np.round(image.array / detector.electrons_per_dn + detector.offset)
        found = tetra3rs.extract_centroids_fast(np.clip(numbers, 0, 4095).astype(np.float32))
        answer = base.solve_from_centroids(
            found.centroids,
            fov_estimate_deg=field,
            fov_max_error_deg=0.01 * field,
            image_shape=(camera.rows, camera.columns),
        )
        if isinstance(answer, tetra3rs.SolveFailure):
            return math.nan
        seen = Rotation.from_matrix(np.array(answer.rotation_matrix_icrs_to_camera))
        boresight = (seen.inv().apply([0, 0, 1.0]), attitude.inv().apply([0, 0, 1.0]))
        return float(np.linalg.norm(boresight[0] - boresight[1]))

    return one


def scaling(case: Case, quick: bool) -> dict[str, Any]:
    """Milliseconds per trial over stars, pixels and workers, for each fidelity."""
    repeats, batch = (1, dict.fromkeys(Fidelity, 2)) if quick else (REPEATS, BATCH)
    made: dict[str, Any] = {"stars": [], "pixels": [], "workers": []}
    for limit in (5.5, 6.2, 7.0, 7.5)[: 1 if quick else None]:
        few = replace(case, catalog=replace(case.catalog, limit_g=limit))
        row = {f.value: cpu_ms(few, f, -(-batch[f] // 4), repeats) for f in Fidelity}
        stars = summarise(run_trials(few, SEED, range(2 if quick else 40), Fidelity.WINDOW)).stars
        made["stars"].append({"at": stars} | row)
    for pixels in (256, 512, 1024, 2048)[: 1 if quick else None]:
        one = studies.sized(case, pixels)
        made["pixels"].append({"at": pixels})
        made["pixels"][-1] |= {
            f.value: cpu_ms(one, f, -(-batch[f] // 4), repeats) for f in Fidelity
        }
    for workers in (1, 2)[: 1 if quick else None]:
        row = {f.value: wall_ms(case, f, workers, 2 * batch[f], repeats) for f in Fidelity}
        made["workers"].append({"at": workers} | row)
    return made


def wall_ms(case: Case, fidelity: Fidelity, workers: int, n: int, repeats: int) -> float:
    """Wall-clock time per trial with a number of workers, shortest of the repeats, millisecond."""
    best = math.inf
    warm(case, Sampling(fidelity))
    with pool(workers) as executor:
        run(case, min(8, n) * workers, SEED, executor, workers=workers, fidelity=fidelity)
        for _ in range(repeats):
            began = time.perf_counter()
            run(case, n, SEED, executor, workers=workers, fidelity=fidelity)
            best = min(best, time.perf_counter() - began)
    return 1e3 * best / n


def cpu_ms(case: Case, fidelity: Fidelity, n: int, repeats: int) -> float:
    """CPU time per trial, shortest of the repeats, millisecond."""
    run_trials(case, SEED, range(min(3, n)), fidelity)
    best = math.inf
    for _ in range(repeats):
        began = time.process_time()
        run_trials(case, SEED, range(n), fidelity)
        best = min(best, time.process_time() - began)
    return 1e3 * best / n


@styled
def draw(made: dict[str, Any], path: Path) -> None:
    """Draw three panels."""
    trials_each = ", ".join(f"{n // 4} of {fidelity}" for fidelity, n in BATCH.items())
    figure = picture(
        9.5, f"Best of {REPEATS} repeats of {trials_each}; eight times as many by workers"
    )
    panels = figure.subplots(3, 1)
    labels = ("matched stars (number in the field)", "side (pixel)", "worker processes (number)")
    for axes, rows, label in zip(panels, made.values(), labels, strict=True):
        for fidelity, colour, mark in zip(Fidelity, CYCLE, MARKERS, strict=False):
            at = [r["at"] for r in rows]
            axes.plot(at, [r[fidelity] for r in rows], f"{mark}-", color=colour, label=fidelity)
        axes.set(xlabel=label, yscale="log", ylabel="CPU time of a trial (ms)")
    panels[1].set_xscale("log", base=2)
    sides = [row["at"] for row in made["pixels"]]
    panels[1].set_xticks(sides, labels=[str(side) for side in sides])
    panels[2].set_xticks([1, 2])
    panels[2].set_ylabel("wall time of a trial (ms)")
    legend_below(panels[2], 4)
    save_picture(path, figure)


if __name__ == "__main__":
    command.run(main)
