"""How long does each stage take, and how large is its error, here and in other programs?

Every stage of `startrack tools bench` with its peers: the same work, in alternating runs, on one
thread. Peers that are not installed are left out and named; cedar-solve runs in the interpreter
that STARTRACK_CEDAR names, because it needs an older numpy.

    python experiments/speed_vs_error.py [--out DIR] [--json FILE] [--quick] [STAGE ...]

writes speed_vs_error.md, .json and .png.
"""

from __future__ import annotations

from startrack.core import Floats

import one_thread  # noqa: F401  # isort: skip

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import command
import cv2
import numpy as np
import psf_peers
from attitude import scipy_one_by_one
from detection import peers as finders
from identification import peers as solvers
from optimiser import by_cmaes, by_tpe
from radiometry import by_scipy
from rendering import galsim_noise, galsim_stars, numpy_exact, numpy_normal, opencv_randn, quantise
from rendering_pyxel import camera, chain
from speed import peer as galsim_tetra3
from terrain import Embree

from startrack.benchmark import (
    STAGES,
    BenchmarkStage,
    Clocked,
    Way,
    draw_benchmark,
    markdown,
    measure,
    values,
    versions,
)
from startrack.benchmark import detection as spots
from startrack.benchmark import earth as cases
from startrack.benchmark import earth as rays
from startrack.benchmark import frame as frames
from startrack.benchmark import optics as patterns
from startrack.benchmark import solving as skies
from startrack.benchmark import studies as hills
from startrack.io import save_json, save_text

PACKAGES = (
    *("galsim", "sep", "tetra3rs", "hcipy", "prysm", "poppy", "photutils", "pyxel-sim"),
    *("embreex", "optuna", "cma", "sasktran2"),
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("stages", nargs="*", metavar="STAGE", help="stages to run (default: all)")
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR")
    # Other stages take minutes at their single size.
    options = command.read(parser, stages=["stamping", "attitude"])
    cv2.setNumThreads(1)
    stages, rows, absent = [], [], set[str]()
    for name in options.stages or STAGES:
        print(name, "...", file=sys.stderr, flush=True)
        stage = STAGES[name]()
        peers = present(PEERS[name], stage, absent)
        stages.append(stage)
        rows += measure(stage, peers, 1) if options.quick else measure(stage, peers)
    left = f"Not installed: {', '.join(sorted(absent))}.\n\n" if absent else ""
    text = (
        f"# Speed against error\n\n`python experiments/speed_vs_error.py`, {versions(PACKAGES)}; "
        "CPU time of one thread, the least of up to five rounds; programs run alternately, "
        f"startrack's rows are bold.\n\n{left}{markdown(stages, rows)}"
    )
    out = options.out / "speed_vs_error.md"
    save_text(out, text)
    figures = {"absent": sorted(absent), **values(stages, rows)}
    save_json(out.with_suffix(".json"), figures)
    command.save(options, figures)
    draw_benchmark(out.with_suffix(".png"), stages, rows)
    print(text)


Maker = Callable[[], dict[str, Way]]


def present(makers: dict[str, Maker], stage: BenchmarkStage, absent: set[str]) -> dict[str, Way]:
    """The ways of the installed peers; `absent` names the others."""
    ways: dict[str, Way] = {}
    for name, make in makers.items():
        try:
            ways |= make()
        except (ImportError, AttributeError) as error:
            print(f"{stage.name}: no {name}: {error}", file=sys.stderr)
            absent.add(name)
    return ways


def pattern(name: str) -> dict[str, Way]:
    maker = psf_peers.present()[name] if name in psf_peers.present() else missing(name)
    made = maker(patterns.FIELD, patterns.NOLL)
    peak = made.clear().max() / patterns.TestPattern().clear().max()
    return {name: lambda: made.aberrated(patterns.COEFFICIENTS) / peak}


def stamper(name: str) -> dict[str, Way]:
    found = psf_peers.present()
    draw = (found[name] if name in found else missing(name)).gauss_stamp(
        patterns.SIGMA, patterns.BOX
    )
    return {name: lambda: [draw(x, y) for x, y in patterns.star_positions()]}


def missing(name: str) -> Any:
    raise ImportError(f"{name} is not installed")


def noise_of(name: str, draw: Callable[..., Any]) -> dict[str, Way]:
    even = np.full((frames.SIZE, frames.SIZE), frames.BACKGROUND)
    draw(even[:8, :8], frames.EVEN_CAMERA, 0)
    return {name: lambda: [draw(even, frames.EVEN_CAMERA, n) for n in range(frames.FRAMES)]}


def pyxel() -> dict[str, Way]:
    ccd = camera()
    even = np.full((frames.SIZE, frames.SIZE), frames.BACKGROUND)
    return {"pyxel": lambda: [chain(ccd, even, 0.0, 1 + n) for n in range(frames.FRAMES)]}


def galsim_frame() -> dict[str, Way]:
    stars = frames.scenery()

    def draw() -> Any:
        electrons = galsim_stars(*stars, frames.SIZE, frames.BACKGROUND)
        return galsim_noise(electrons + frames.DARK, frames.CAMERA, 0)

    draw()
    return {"galsim": draw}


def numpy_frame() -> dict[str, Way]:
    """Poisson and normal numbers of numpy on GalSim's stars: common user code."""
    stars = frames.scenery()

    def draw() -> Any:
        electrons = galsim_stars(*stars, frames.SIZE, frames.BACKGROUND) + frames.DARK
        rng = np.random.default_rng(1)
        noise = frames.READ_NOISE * rng.standard_normal(electrons.shape)
        return quantise(rng.poisson(electrons) + noise, frames.CAMERA)

    draw()
    return {"galsim + numpy": draw}


def finder(name: str, snr: float, spacing: int = spots.SPACING) -> dict[str, Way]:
    found = finders(spots.SIGMA)
    frame = spots.star_frame(snr, spacing)[0]
    # tetra3rs has two detection functions.
    ways: dict[str, Way] = {
        key: partial(find, frame) for key, find in found.items() if key.startswith(name)
    }
    return ways or missing(name)


def solver(name: str) -> dict[str, Way]:
    every = skies.skies()
    ways: dict[str, Way] = {}
    for key, solve in solvers(skies.REGIME):
        if key.startswith(name):

            def run(solve: Any = solve) -> Clocked:
                answers = [solve(seen) for seen in every]
                return Clocked([one for one, _ in answers], sum(spent for _, spent in answers))

            ways[key] = run
    return ways or missing(name)


def aligner() -> dict[str, Way]:
    _, b, r = skies.fields(skies.MANY, skies.STARS, np.radians(10), 0.0, 1)
    return {"scipy": lambda: scipy_one_by_one(b, r, np.ones(b.shape[:2]))}


def embree() -> dict[str, Way]:
    scene = Embree(*cases.mountains(rays.CELLS))
    looks = scene.single(rays.rays_down())
    return {"embree": lambda: scene.distance(*looks)}


def two_programs() -> dict[str, Way]:
    one = galsim_tetra3(hills.example())
    if one is None:
        return missing("galsim or tetra3rs")
    return {"galsim + tetra3rs": lambda: np.array([one(n) for n in range(hills.TRIALS)])}


def search(name: str, by: Callable[..., Floats], package: str) -> dict[str, Way]:
    __import__(package)
    hill = hills.hill()

    def score(place: Floats) -> float:
        return hills.finite(hill.score(place))

    return {name: lambda: by(score, hill.start, 1, hills.TRIES)}


PEERS: dict[str, dict[str, Maker]] = {
    "psf": {name: partial(pattern, name) for name in psf_peers.PATTERNS},
    "stamping": {name: partial(stamper, name) for name in ("galsim", "photutils")},
    "noise": {
        "numpy": partial(noise_of, "numpy", numpy_exact),
        "numpy normal": partial(noise_of, "numpy normal", numpy_normal),
        "opencv": partial(noise_of, "opencv randn", opencv_randn),
        "galsim": partial(noise_of, "galsim", galsim_noise),
        "pyxel-sim": pyxel,
    },
    "frame": {"galsim": galsim_frame, "galsim ": numpy_frame},
    "detection": {name: partial(finder, name, spots.FAINT) for name in ("tetra3rs", "sep")},
    "quick-detection": {"tetra3rs": partial(finder, "tetra3rs", spots.FEW_SNR, spots.FEW_SPACING)},
    "centroid": {name: partial(finder, name, spots.BRIGHT) for name in ("tetra3rs", "sep")},
    "identification": {name: partial(solver, name) for name in ("tetra3rs", "cedar-solve")},
    "attitude": {"scipy": aligner},
    "terrain": {"embreex": embree},
    "radiance": {"scipy": by_scipy},
    "montecarlo": {"tetra3rs": two_programs},
    "optimiser": {
        "optuna": partial(search, "optuna TPE", by_tpe, "optuna"),
        "cma": partial(search, "CMA-ES", by_cmaes, "cma"),
    },
}

if __name__ == "__main__":
    command.run(main)
