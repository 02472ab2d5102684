"""Measured figures of flown cameras, for `flown.py --measure FOLDER`, from published files.

FOLDER contains, under their original names, `results_table_post_process.ipynb` and
`photometry.ipynb` of evanmayer/starcam-sim (pipeline), the two `.dat` of bbuysschaert/BRITE_decor
and the three `.fits` of BlastTNG/flight (stars/practice_images). None of them is redistributed.
Values that notebooks print for fits, and values for TESS, are copied below with their source.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from astropy.io import fits
from flown_cameras import BLOCKS, BRITE
from scipy import ndimage

from startrack.core import Floats, Ints

Seen = dict[str, tuple[float, str]]
NOTEBOOK = "starcam-sim pipeline/results_table_post_process.ipynb, cell 10"
PHOTOMETRY = "starcam-sim pipeline/photometry.ipynb"
# a, k, b of cell 18, percentile 50 of cell 19, the linear coefficient of cell 32, cell 49;
# libstarcam says 7 to 13 times the width of diffraction in flight.
FIT = (487.772919, -0.301852219, -0.303235192)
FAINTEST, COLOUR, BACKGROUND, WIDTHS = (
    8.505024909973145,
    0.34860767,
    406.30958912327844,
    (7.0, 13.0),
)
TESS = 2.56  # ssmichael1/tetra3rs CHANGELOG.md, 0.5.0: sector 17; all ten stay below 9 in README.md
# Of `startrack solve --catalog deep --fov 4.05 --fov-tolerance 0.02 --epoch 2013 FRAME` (some
# minutes a frame): matched stars, and residual, pixel rms of an axis; none of the first.
SOLVED = ((0, math.nan), (17, 0.396505), (65, 0.275040))
EBEX_SCALE = 9.52  # arcsec / pixel, by these solutions
FRAMES = (
    "2012-12-30--07-14-40--687_p1.fits",
    "2012-12-30--08-27-56--625_p1.fits",
    "2013-01-01--06-11-24--859_p0.fits",
)
FILES = {
    "unibrite": "HD37043_1_OrionI-2013_UBr_setup7_APa2s5_R2.dat",
    "heweliusz": "HD37742_6_OrionII-2014_BHr_setup7_APa2s5_R2.dat",
}
BANDS = {"below 15": (-99, 15), "15 to 25": (15, 25), "25 to 35": (25, 35), "above 35": (35, 99)}


def robust(values: Floats) -> float:
    """Standard deviation from the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def tim(folder: Path) -> Seen:
    """T1 to T13."""
    cell = json.loads((folder / "results_table_post_process.ipynb").read_text())["cells"][10]
    text = "".join(cell["outputs"][0]["text"])
    lines = [line.split() for line in text.splitlines() if "saved_image" in line]
    column = {
        "solved": 10,
        "time": 12,
        "found": 17,
        "matched": 18,
        "rms": 19,
        "level": 21,
        "again": 22,
    }
    table = {
        name: np.array([float(line[at].replace("--", "nan")) for line in lines])
        for name, at in column.items()
    }
    solved = table["solved"] > 0
    level = table["level"]
    seen: Seen = {"T1": (float(solved.mean()), NOTEBOOK)}
    for name, key in (("T2", "found"), ("T3", "matched"), ("T4", "again"), ("T5", "rms")):
        seen[name] = (float(np.nanmedian(table[key][solved])), NOTEBOOK)
    for name, at in (("T6", 50), ("T6 16 %", 16), ("T6 84 %", 84)):
        seen[name] = (float(np.percentile(level, at)), NOTEBOOK)
    begin = []
    for label, *_ in BLOCKS:
        hour, minute = map(int, label.split(":"))
        day = 2 if hour == 0 else 1
        begin.append(datetime(2025, 10, day, hour, minute, tzinfo=UTC).timestamp())
    block = np.argmin(np.abs(table["time"][:, None] - np.array(begin) - 75), axis=1)
    median = [float(np.median(level[block == k])) for k in range(len(BLOCKS))]
    for k, (label, *_) in enumerate(BLOCKS):
        if k != 4:
            seen[f"T7 {label}"] = (median[k] / median[4], NOTEBOOK)
    scale, power, zero = FIT
    for rp in (3, 5, 7):
        seen[f"T8 RP {rp}"] = (scale * 10 ** (power * rp) + zero, PHOTOMETRY)
    seen["T9"] = (math.log10((3 - zero) / scale) / power, PHOTOMETRY)
    seen["T10"], seen["T11"] = (FAINTEST, PHOTOMETRY), (COLOUR, PHOTOMETRY)
    for name, width in zip(("T12 least", "T12 largest"), WIDTHS, strict=True):
        seen[name] = (width, "starcam-sim libstarcam.py, as a typical range")
    return seen | {"T13": (BACKGROUND, PHOTOMETRY + ", a mean")}


def ebex(folder: Path) -> Seen:
    """E1 to E8."""
    seen: Seen = {}
    levels, noises = [], []
    for k, name in enumerate(FRAMES, 1):
        with fits.open(folder / name) as parts:
            frame = parts[0].data.astype(float)
        level, noise = float(np.median(frame)), robust(np.diff(frame, axis=1)) / math.sqrt(2)
        rows, columns = (size // 8 for size in frame.shape)
        blocks = frame[: rows * 8, : columns * 8].reshape(rows, 8, columns, 8).mean((1, 3))
        smooth = ndimage.median_filter(blocks, 7)
        places = [(np.arange(size) - 3.5) / 8 for size in frame.shape]
        grid = np.meshgrid(*places, indexing="ij")
        rest = frame - ndimage.map_coordinates(smooth, grid, order=1, mode="nearest")
        mean = ndimage.uniform_filter(rest, 3)
        sigma = robust(mean)
        peak = (mean == ndimage.maximum_filter(mean, 11)) & (mean > 8 * sigma)
        inner = np.zeros_like(peak)
        inner[16:-16, 16:-16] = True
        peak &= inner
        lit = rest > 4 * noise
        others = ndimage.convolve(lit.astype(int), np.ones((3, 3), int), mode="constant") - lit
        lone = (rest > 8 * noise) & (others == 0)
        here = f"BlastTNG/flight {name}"
        seen |= {
            f"E1 {k}": (level, here),
            f"E2 {k}": (noise, here),
            f"E4 {k}": (float(peak.sum()), here),
            f"E5 {k}": (float(mean[peak].max() / sigma), here),
            f"E8 {k}": (float(lone.sum()), here),
        }
        levels.append(level)
        noises.append(noise)
    for k, (matched, _) in enumerate(SOLVED, 1):
        seen[f"E6 matched {k}"] = (float(matched), "startrack solve --catalog deep")
    residual = np.array([rms for _, rms in SOLVED]) * EBEX_SCALE * math.sqrt(2)
    seen["E6"] = (float(np.isfinite(residual).sum()), "startrack solve --catalog deep")
    seen["E7"] = (float(np.nanmedian(residual)), "startrack solve --catalog deep, of two frames")
    slope = float(np.polyfit(levels, np.square(noises), 1)[0])
    return seen | {"E3 slope": (slope, "the three frames")}


def brite(name: str, folder: Path) -> Seen:
    """B1 to B8 of a satellite."""
    text = (folder / FILES[name]).read_text().splitlines()
    rows = np.array([line.split() for line in text if line.strip() and line[0] != "c"], float)
    time, flux, x, y, celsius, _, flag = rows.T[:7]
    orbits = np.split(np.arange(len(time)), np.flatnonzero(np.diff(time) > 30 / 1440) + 1)
    orbits = [some for orbit in orbits if len(some := orbit[flag[orbit] == 1]) >= 10]

    def noise(orbit: Ints) -> float:
        return robust(np.diff(flux[orbit])) / math.sqrt(2) / float(np.median(flux[orbit]))

    level = float(np.median(flux[flag == 1]))
    typical = middle(noise, orbits)
    figures = {"B1": level, "B2": typical, "B3": typical * math.sqrt(level * 3.2)}
    for axis, place in (("x", x), ("y", y)):
        figures[f"B4 {axis}"] = middle(lambda orbit, at=place: float(at[orbit].std()), orbits)
        figures[f"B5 {axis}"] = middle(
            lambda orbit, at=place: robust(np.diff(at[orbit])) / math.sqrt(2), orbits
        )
    warm = np.array([np.median(celsius[orbit]) for orbit in orbits])
    for label, (low, high) in BANDS.items():
        some = [orbit for orbit, own in zip(orbits, warm, strict=True) if low <= own < high]
        if some:
            figures[f"B6 {label}"] = middle(noise, some)
    day = np.array([time[orbit].mean() for orbit in orbits])
    first, last = day.min() + 0.2 * np.ptp(day), day.min() + 0.8 * np.ptp(day)
    early = [orbit for orbit, own in zip(orbits, day, strict=True) if own < first]
    late = [orbit for orbit, own in zip(orbits, day, strict=True) if own > last]
    figures["B7"] = middle(noise, late) / middle(noise, early)
    figures["B8"] = float((flag == 0).mean())
    return {f"{name} {key}": (value, FILES[name]) for key, value in figures.items()}


def middle(figure: Callable[[Ints], float], orbits: Sequence[Ints]) -> float:
    """Median of a figure over orbits."""
    return float(np.median([figure(orbit) for orbit in orbits]))


def parts(folder: Path) -> Iterator[Seen]:
    """The measured figures of each camera."""
    yield tim(folder)
    yield ebex(folder)
    for name in BRITE:
        yield brite(name, folder)
    yield {"G4": (TESS, "ssmichael1/tetra3rs CHANGELOG.md 0.5.0, sector 17, one chip of four")}


def measured(folder: Path) -> dict[str, dict[str, Any]]:
    """Value and source of each figure."""
    return {
        name: {"value": float(f"{value:.5g}"), "source": source}
        for seen in parts(folder)
        for name, (value, source) in seen.items()
    }
