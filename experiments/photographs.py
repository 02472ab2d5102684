"""Question: which photographs of the sky are solved, how accurate are the stated errors, and is any
solution wrong?

Answer: a line for each photograph, without a field of view and with it: error relative to the
attitude by other solvers, over the stated sigma. Then the fraction of images without a sky that are
solved, which must be zero, and the CPU time; images that an earlier commit solved and this commit
does not (`regressions`); and the error over sigma for two images of a series, with a camera
calibrated on four others (`camera_sigma`). Images without a sky are synthetic (gradients, noise,
hot pixels, city lights, grids, foliage, random dots) or real: photographs with small parts
shuffled, rotated and mirrored, so that distances between stars change.

    STARTRACK_DATA=folder python experiments/photographs.py [--json FILE] [--skyless N] [--quick]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import command
import cv2
import numpy as np
from numpy.typing import NDArray

from startrack import Frame, read_image
from startrack.catalog import Selection, open_sky
from startrack.cli import main as startrack
from startrack.identification import Identification, PatternIndexes
from startrack.photograph import Photograph, solve_photograph

EPOCH = 2016.0  # epoch of the catalogue of the known attitudes
WRONG = 0.02  # fraction of the field: a larger error is a wrong attitude
GUESSES = (0.91, 1.0, 1.09)  # factors of the true field
LIMIT = 30.0  # arcsec across, largest error
SIZES = ((1024, 768), (1280, 960), (800, 800))  # columns and rows of images without a sky
LARGE = (4000, 3000)
# A series of one camera: images for its calibration, and images for the judgement.
CALIBRATED = ("gr_andromeda.jpg", "gr_casiopea.jpg", "gr_cisne.jpg", "gr_sagitario.jpg")
JUDGED = ("gr_vega_05sec.jpg", "gr_pleyades_05sec.jpg")
# Solved without a field of view at commit 16fe6cad.
SOLVED = (
    "esa_Alt40_Azi-135.tiff",
    "esa_Alt40_Azi-45.tiff",
    "esa_Alt40_Azi135.tiff",
    "esa_Alt40_Azi45.tiff",
    "cedar_crappy.jpg",
    "cedar_hale_bopp.jpg",
    "cedar_jan1_g90_e100ms.jpg",
    "cedar_orion_belt.jpg",
    "cedar_orion_trees.jpg",
    "cedar_virgo.jpg",
    "ost_img2.png",
    "ost_img3.png",
    "ost_img5.png",
    "ost_img9.png",
    "unh_0045.jpg",
    "ar_IMG_3053.jpg",
    "lm_acc.png",
    "us_23.png",
    "sams_1.png",
    "sams_17.png",
    "picam_1.png",
    "gr_andromeda.jpg",
    "gr_casiopea.jpg",
    "gr_cisne.jpg",
    "gr_sagitario.jpg",
    "gr_vega_05sec.jpg",
    "gr_pleyades_05sec.jpg",
    "pp_IMG_0005.jpg",
    "tc16u_southern_maybe.png",
    *(f"img_{n}.jpg" for n in range(1, 50, 2)),
)
TILES = (16, 12)  # tiles of shuffled photographs
KINDS = ("gradient", "noise", "hot", "lamps", "grid", "foliage", "dots", "shuffled")


def solve(path: Path, *more: str) -> tuple[dict, float]:
    """Result of `startrack solve` for an image, and CPU time in seconds."""
    arguments = ["solve", str(path), "--epoch", str(EPOCH), "--json", *more]
    if path.name.startswith("ost"):
        arguments += ["--dark", str(path.parent / "ost_dark.png")]
    text = io.StringIO()
    began = time.process_time()
    with contextlib.redirect_stdout(text):
        startrack(arguments)
    return json.loads(text.getvalue()), time.process_time() - began


def known(root: Path) -> Iterator[tuple[Path, dict]]:
    """Each available image with a known attitude, and its known values."""
    for file in sorted(root.glob("images*/truth.json")):
        for name, truth in json.loads(file.read_text())["images"].items():
            if (file.parent / name).exists():
                yield file.parent / name, truth


def off(found: dict, truth: dict) -> tuple[float, float]:
    """Error across the boresight (arcsec), and its ratio to the stated sigma combined with the
    reference's."""
    places = (found["ra_deg"], found["dec_deg"]), (truth["ra_deg"], truth["dec_deg"])
    one, other = (_direction(*place) for place in places)
    if "R_icrs_to_cam" in truth:
        other = np.array(truth["R_icrs_to_cam"])[2]
    error = 3600 * math.degrees(2 * math.asin(float(np.linalg.norm(one - other)) / 2))
    x, y, _ = found["sigma_arcsec"]
    spread = truth.get("spread_arcsec", math.nan)
    return error, error / math.sqrt((x * x + y * y + spread**2) / 2)


def _direction(ra: float, dec: float) -> NDArray[np.float64]:
    longitude, latitude = math.radians(ra), math.radians(dec)
    flat = math.cos(latitude)
    return np.array([flat * math.cos(longitude), flat * math.sin(longitude), math.sin(latitude)])


def right(folder: Path, images: int | None = None) -> Iterator[bool]:
    """Whether each of the first images is solved within 30 arcsec for every guess of the field."""
    with_matrix = (pair for pair in known(folder.parent) if "R_icrs_to_cam" in pair[1])
    for path, truth in islice(with_matrix, images):
        answers = [solve(path, "--fov", str(truth["fov_x_deg"] * g))[0] for g in GUESSES]
        yield all(a["ra_deg"] is not None and off(a, truth)[0] < LIMIT for a in answers)


def row_of(path: Path, truth: dict) -> dict[str, Any]:
    """Row of a photograph, without its field of view and with it."""
    row: dict[str, Any] = {"image": f"{path.parent.name}/{path.name}"}
    for name, more in (("blind", ()), ("hinted", ("--fov", str(truth["fov_x_deg"])))):
        found, seconds = solve(path, *more)
        answer: dict[str, Any] = {"status": found["status"], "seconds": seconds}
        if found["ra_deg"] is not None:
            error, normalised = off(found, truth)
            answer |= {
                "error_arcsec": error,
                "sigma_arcsec": math.hypot(*found["sigma_arcsec"][:2]) / math.sqrt(2),
                "normalised": None if math.isnan(normalised) else normalised,
                "wrong": error > WRONG * 3600 * truth["fov_x_deg"],
                **{key: found[key] for key in ("matches", "spots", "mirrored", "aspect")},
            }
        row[name] = answer
    shown = [
        f"{a['error_arcsec']:.1f} | {a['sigma_arcsec']:.1f} | {a['matches']} / {a['spots']} "
        f"| {a['seconds']:.2f}"
        if "wrong" in a
        else f"{a['status']} | | | {a['seconds']:.2f}"
        for a in (row["blind"], row["hinted"])
    ]
    print(f"| {row['image']} | {' | '.join(shown)} |", flush=True)
    return row


def camera_errors(root: Path) -> list[float]:
    """Errors over sigma with a camera calibrated on other images; empty without these images."""
    images = {path.name: (path, truth) for path, truth in known(root)}
    if not {*CALIBRATED, *JUDGED} <= images.keys():
        return []
    with tempfile.TemporaryDirectory() as folder:
        camera = Path(folder, "camera.toml")
        paths = [str(images[name][0]) for name in CALIBRATED]
        with contextlib.redirect_stdout(io.StringIO()):
            startrack(["calibrate", *paths, "--epoch", str(EPOCH), "--camera", str(camera)])
        errors = []
        for path, truth in (images[name] for name in JUDGED):
            found, _ = solve(path, "--camera", str(camera))
            errors.append(math.inf if found["ra_deg"] is None else off(found, truth)[1])
            print(f"{path.name} by the calibrated camera: {errors[-1]:.2f} of sigma", flush=True)
    return errors


def without_sky(kind: str, number: int, size: tuple[int, int]) -> NDArray[np.uint8]:
    """An 8-bit image without a sky."""
    rng = np.random.default_rng([20261124, KINDS.index(kind), number])
    columns, rows = size
    x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows))
    turn = rng.uniform(0, 2 * np.pi)
    image = rng.uniform(5, 60) + rng.uniform(0, 60) * (x * np.cos(turn) + y * np.sin(turn))
    if kind == "shuffled":
        return shuffled(number, rng, size)
    if kind == "foliage":
        image += 90 * (_texture(rng, rows, columns) > rng.uniform(-1, 1)) * rng.uniform(0.2, 1)
    if kind == "hot":
        place = rng.integers(0, rows * columns, 400)
        image.flat[place] += rng.exponential(60, 400)
    if kind in ("lamps", "grid", "dots"):
        _light(image, *_lamps(kind, rng, columns, rows), rng)
    image += rng.normal(0, rng.uniform(0.5, 6), image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def _texture(rng: np.random.Generator, rows: int, columns: int) -> NDArray[np.float64]:
    """Noise of variance one, with a power spectrum as for leaves and clouds."""
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)
    power = np.maximum(np.hypot(fy, fx), 1 / columns) ** -rng.uniform(0.8, 1.8)
    made = np.fft.irfft2(
        np.fft.rfft2(rng.standard_normal((rows, columns))) * power, (rows, columns)
    )
    return np.asarray((made - made.mean()) / made.std())


def _lamps(
    kind: str, rng: np.random.Generator, columns: int, rows: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places of lights: random, along streets, or on a grid in perspective."""
    count = int(rng.integers(15, 250))
    if kind == "dots":
        return rng.uniform(0, columns, count), rng.uniform(0, rows, count)
    if kind == "lamps":
        street = rng.integers(0, max(count // 20, 1), count)
        at, angle = rng.uniform(0, 1, (2, count)), rng.uniform(0, np.pi, count)[street]
        start = rng.uniform(0, [[columns], [rows]], (2, count))[:, street]
        along = columns * (at[0] - 0.5)
        return start[0] + along * np.cos(angle), start[1] + along * np.sin(angle) * 0.3
    side = max(round(math.sqrt(count)), 3)
    u, v = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    turn, tilt = rng.uniform(0, np.pi), rng.uniform(0, 0.6)
    across, down = u * np.cos(turn) - v * np.sin(turn), u * np.sin(turn) + v * np.cos(turn)
    depth = 1 + tilt * down
    return (
        columns / 2 * (1 + 0.8 * across / depth).ravel(),
        rows / 2 * (1 + 0.8 * down / depth).ravel(),
    )


def _light(
    image: NDArray[np.float64],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    rng: np.random.Generator,
) -> None:
    """Add lights of widths and brightness at random."""
    width = rng.uniform(0.8, 3)
    for u, v in zip(x.tolist(), y.tolist(), strict=True):
        sigma = width * rng.uniform(0.8, 1.5)
        half = math.ceil(4 * sigma)
        left, top = max(round(u) - half, 0), max(round(v) - half, 0)
        part = image[top : max(round(v) + half + 1, 0), left : max(round(u) + half + 1, 0)]
        if part.size:
            dy, dx = np.indices(part.shape)
            square = (dx + left - u) ** 2 + (dy + top - v) ** 2
            part += rng.lognormal(4, 1) * np.exp(-square / 2 / sigma**2)


@cache
def photographs(root: Path) -> list[Path]:
    """The photographs for shuffling."""
    return [path for path, _ in known(root)]


def shuffled(number: int, rng: np.random.Generator, size: tuple[int, int]) -> NDArray[np.uint8]:
    """A photograph with parts shuffled, rotated and mirrored."""
    folder = command.images("shuffled photographs are")
    if folder is None:
        return without_sky("dots", number, size)
    paths = photographs(folder.parent)
    image = np.asarray(read_image(paths[number % len(paths)]).image, np.float32)
    image = np.clip(255 * image / np.percentile(image, 99.95), 0, 255)
    across, down = TILES
    side = min(image.shape[1] // across, image.shape[0] // down)
    parts = [
        image[j * side : (j + 1) * side, i * side : (i + 1) * side]
        for j in range(image.shape[0] // side)
        for i in range(image.shape[1] // side)
    ]
    parts = [
        np.rot90(parts[k], int(rng.integers(4)))[:: int(rng.choice([-1, 1]))]
        for k in rng.permutation(len(parts))[: across * down]
    ]
    lines = [np.hstack(parts[k * across : (k + 1) * across]) for k in range(len(parts) // across)]
    return np.vstack(lines).astype(np.uint8)


@cache
def indexes() -> PatternIndexes:
    """Indexes of the catalogue of `solve`."""
    cv2.setNumThreads(1)
    return PatternIndexes(open_sky(Selection.whole("bright", EPOCH)).stars)


def search(image: NDArray[np.uint8]) -> tuple[Photograph, float]:
    """The solution of an image, and CPU time in seconds."""
    began = time.process_time()
    found = solve_photograph(Frame(image), indexes(), Identification(focal_tolerance=0.1))
    return found, time.process_time() - began


def falsely_solved(number: int) -> str:
    """The kind of an image without a sky and its solution; empty without a solution."""
    kind = KINDS[number % len(KINDS)]
    found, _ = search(without_sky(kind, number, SIZES[number % len(SIZES)]))
    if found.axis is None:
        return ""
    return f"{kind} {number}: {found.estimate.reason}, {str(found.view) or 'as it is'}, bound " + (
        f"{found.estimate.false_probability:.0e}"
    )


def false_solutions(count: int) -> list[str]:
    """The images without a sky that are solved."""
    with ProcessPoolExecutor() as pool:
        found = [text for text in pool.map(falsely_solved, range(count), chunksize=4) if text]
    for text in found:
        print(f"without a sky, but solved: {text}", flush=True)
    return found


def refused_large(images: int) -> float:
    """Longest search (CPU time, second) of images of 12 megapixels without a sky, with loaded
    indexes."""
    search(without_sky("dots", 0, SIZES[0]))
    kinds = ("lamps", "foliage", "dots", "noise")[:images]
    return max(search(without_sky(kind, 1, LARGE))[1] for kind in kinds)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--skyless", type=int, default=1000, help="number of images without a sky")
    options = command.read(parser, skyless=4)
    cv2.setNumThreads(1)
    rows: list[dict[str, Any]] = []
    if folder := command.images("real images are"):
        print(
            "| image | error (arcsec) | sigma (arcsec) | matches / spots | CPU (s) "
            "| with its field: error | sigma | matches / spots | CPU (s) |"
        )
        print("|---" * 9 + "|")
        images = list(islice(known(folder.parent), 1 if options.quick else None))
        solve(images[0][0])  # loading of the index and compilation do not count
        rows = [row_of(path, truth) for path, truth in images]
    solved = [row["blind"] for row in rows if "wrong" in row["blind"]]
    normalised = [a["normalised"] for a in solved if a["normalised"] is not None]
    wrong = [a["wrong"] for row in rows for a in (row["blind"], row["hinted"]) if "wrong" in a]
    by_camera = camera_errors(folder.parent) if folder and not options.quick else []
    regressions = [
        row["image"]
        for row in rows
        if "wrong" not in row["blind"] and Path(row["image"]).name in SOLVED
    ]
    lost = [row for row in rows if "wrong" in row["blind"] and "wrong" not in row["hinted"]]
    false = false_solutions(options.skyless)
    figures = {
        "solved": len(solved),
        "of": len(rows),
        "wrong": sum(wrong),
        "hint_worse": len(lost),
        "regressions": len(regressions),
        "camera_sigma": np.percentile(by_camera, (50, 95)).tolist() if by_camera else None,
        "normalised_error": np.percentile(normalised, (50, 95)).tolist() if normalised else None,
        "false_of_1000": 1000 * len(false) / options.skyless,
        "skyless": options.skyless,
        "refused_s": refused_large(1 if options.quick else 4),
        "solved_s": max((a["seconds"] for a in solved), default=None),
        "images": rows,
    }
    for name in regressions:
        print(f"solved at an earlier commit but not now: {name}")
    print(json.dumps({k: v for k, v in figures.items() if k != "images"}, indent=1))
    command.save(options, figures)


if __name__ == "__main__":
    command.run(main)
