"""How accurate and how fast is each PSF, compared with other packages?

Time and error come from the same run, on one thread, with alternating runs of startrack and peers.
Peers that are not installed are left out and named. Set-up (grids, masks, modes, plans) is not
timed; a new wavefront, its transform and its squares are timed.

    python experiments/psf_models.py [--json FILE] [--figures DIR] [--quick]

The case: 155 x 155 points a fifth of wavelength * f-number apart, f/1.4 at 550 nm. Errors are
fractions of the peak without aberrations, against the closed form, or a quadrature over rings
and spokes of the pupil where there are aberrations. Stamps: errors of the centroid against the
closed forms integrated over pixels.
"""

from __future__ import annotations

from krutz_2011 import ThinLens, on_axis

from startrack.core import Floats

import one_thread  # noqa: F401  # isort: skip

import argparse
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import command
import numpy as np
import psf_figures
import psf_peers

from startrack import Psf
from startrack.benchmark import optics as cases
from startrack.detector import stamp
from startrack.optics import airy, pixel_psf

ROOT = Path(__file__).parents[1]

WAVES = np.linspace(450e-9, 650e-9, 10)
DISKS = (0.14, 0.25, 0.5, 1.0, 2.0)  # wavelength * f-number in pixels
SIGMAS = (0.5, 0.7, 1.0)
ROUNDS = 9
PICKED = 1500  # places for the judgement of aberrated patterns


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--figures", type=Path, metavar="DIR", help="folder for the pictures of figures 6 to 9"
    )
    options = command.read(parser)
    rounds = 1 if options.quick else ROUNDS
    result: dict[str, float] = {}
    peers = psf_peers.present()
    print("peers here:", ", ".join(peers) or "none")
    print("left out:  ", ", ".join(psf_peers.ABSENT) or "none", "\n")
    result |= kirchhoff()
    result |= patterns(peers, rounds, 20 if options.quick else PICKED)
    result |= stamps(peers, rounds, 3 if options.quick else 12)
    for key, value in result.items():
        print(f"{key:42s} {value:.3g}")
    print()
    psf_figures.report(options.figures, psf_figures.F_NUMBERS[:: 24 if options.quick else 1])
    command.save(options, result)


def kirchhoff() -> dict[str, float]:
    """On the axis, against 30 digits, f/1 to f/16."""
    reference = json.loads((ROOT / "tests" / "oracle" / "kirchhoff.json").read_text())
    worst, began, count = 0.0, time.process_time(), 0
    for wavelength, entry in reference["wavelengths"].items():
        for row in entry["rows"]:
            lens = ThinLens(0.02, float(row["R"]), 1.0, float(wavelength) * 1e-9)
            wanted = float(row["kirchhoff"]) / float(row["fresnel"])
            worst = max(worst, abs(abs(on_axis(lens)) ** 2 / wanted - 1))
            count += 1
    spent = (time.process_time() - began) / count * 1e3
    return {"kirchhoff_max_relative_error": worst, "kirchhoff_on_axis_ms": spent}


def patterns(peers: dict[str, Any], rounds: int, picked: int) -> dict[str, float]:
    """The 155 x 155 points: without aberrations, with a new set of aberrations, at ten
    wavelengths."""
    coefficients = 0.05 * np.random.default_rng(7).normal(size=len(cases.NOLL))  # radian
    clear = airy(np.hypot(cases.FIELD, cases.FIELD[:, None]), 1.0, 1.0)
    pick = np.random.default_rng(8).integers(0, len(cases.FIELD), (picked, 2))
    aberrated = cases.by_rings(coefficients, cases.FIELD[pick])
    makers = {"": cases.TestPattern()} | {
        f"_{name}": maker(cases.FIELD, cases.NOLL)
        for name, maker in peers.items()
        if name in psf_peers.PATTERNS
    }
    tasks: dict[tuple[str, str], Callable[[], Floats]] = {}
    for name, maker in makers.items():
        tasks["airy", name] = maker.clear
        tasks["zernike", name] = lambda maker=maker: maker.aberrated(coefficients)  # type: ignore[misc]
        tasks["ten_wavelengths", name] = lambda maker=maker: maker.band(WAVES / cases.WAVELENGTH)  # type: ignore[misc]
    spent = alternate(tasks, rounds)
    result = {}
    for (task, name), seconds in spent.items():
        if task == "ten_wavelengths":
            result[f"ten_wavelengths_ms{name}"] = seconds * 1e3
            continue
        peak = makers[name].clear().max()
        image = tasks[task, name]() / peak
        wrong = image - clear if task == "airy" else image[pick[:, 1], pick[:, 0]] - aberrated
        result[f"{task}_ms{name}"] = seconds * 1e3
        result[f"{task}_error_of_peak{name}"] = float(np.abs(wrong).max())
    began = time.process_time()
    for _ in range(rounds):
        airy(np.hypot(cases.FIELD, cases.FIELD[:, None]), 1.0, 1.0)
    result["airy_closed_form_ms"] = (time.process_time() - began) / rounds * 1e3
    return dict(sorted(result.items()))


def stamps(peers: dict[str, Any], rounds: int, places: int) -> dict[str, float]:
    """One star on pixels at sub-pixel places, by startrack and peers, compared with exact
    integrals."""
    result = {}
    for kind, sizes in (("airy", DISKS), ("gauss", SIGMAS)):
        times: dict[str, list[float]] = {}
        errors: dict[str, list[float]] = {}
        for size in sizes:
            psf = pixel_psf(*cases.lens(kind, size))
            box = 2 * ((psf.table.shape[0] // 2 - 3) // psf.oversampling) + 1
            ways: dict[str, Callable[[float, float], Floats]] = {"": _own_stamp(psf, box)}
            for name, peer in peers.items():
                if hasattr(peer, f"{kind}_stamp"):
                    ways[f"_{name}"] = getattr(peer, f"{kind}_stamp")(size, box)
            points = np.random.default_rng(9).uniform(-0.5, 0.5, (places, 2))
            for x, y in points:
                wanted = cases.centroid(cases.exact(kind, x, y, size, box))
                for name, way in ways.items():
                    errors.setdefault(name, []).append(
                        float(np.mean((cases.centroid(way(x, y)) - wanted) ** 2))
                    )
            spent = alternate(
                {
                    ("", name): lambda way=way: way(0.2, -0.3)  # type: ignore[misc]
                    for name, way in ways.items()
                    if name
                },
                rounds,
            )
            for (_, name), seconds in spent.items():
                times.setdefault(name, []).append(seconds)
            times.setdefault("", []).append(_many(psf, rounds))
        for name, error in errors.items():
            per_size = np.array(error).reshape(len(sizes), -1) if name == "" else None
            rms = np.sqrt(
                per_size.mean(axis=1).max() if per_size is not None else _worst(error, sizes)
            )
            result[f"stamp_{kind}_us{name}"] = max(times[name]) * 1e6
            result[f"stamp_{kind}_centroid_rms_px{name}"] = float(rms)
    return result


def _worst(error: list[float], sizes: tuple[float, ...]) -> float:
    return float(np.array(error).reshape(len(sizes), -1).mean(axis=1).max())


def _own_stamp(psf: Psf, box: int) -> Callable[[float, float], Floats]:
    def way(x: float, y: float) -> Floats:
        image = np.zeros((box, box))
        stamp(image, psf, np.array([box // 2 + x]), np.array([box // 2 + y]), np.ones(1))
        return image

    return way


def _many(psf: Psf, rounds: int) -> float:
    """Seconds per star, for thousands of stars in one image, as in a frame."""
    image, count = np.zeros((200, 200)), 4000
    x, y = np.random.default_rng(3).uniform(30, 170, (2, count))
    light, spent = np.ones(count), []
    for _ in range(rounds):
        began = time.process_time()
        stamp(image, psf, x, y, light)
        spent.append(time.process_time() - began)
    return min(spent) / count


def alternate(
    tasks: dict[tuple[str, str], Callable[[], Floats]], rounds: int
) -> dict[tuple[str, str], float]:
    """CPU time of each task, second, shortest of several rounds of all tasks."""
    least = dict.fromkeys(tasks, math.inf)
    for task in tasks.values():
        task()
    for _ in range(rounds):
        for key, task in tasks.items():
            repeats = 3
            began = time.process_time()
            for _ in range(repeats):
                task()
            least[key] = min(least[key], (time.process_time() - began) / repeats)
    return least


if __name__ == "__main__":
    command.run(main)
