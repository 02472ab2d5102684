"""Errors of stars against magnitude and field position; of the attitude against slew rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Streams, arcsec, deg
from startrack.design import Case
from startrack.metrics import Interval, rms_interval, summarise
from startrack.montecarlo import Serial, run
from startrack.motion import stability
from startrack.report.page import BLUE, HIGH, RED, WIDE, Picture
from startrack.trial import Record, observe

BINS = 8
FEWEST = 8  # stars in a bin, at least; chosen by hand
SMEARS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # pixel in an exposure


class StarErrors(NamedTuple):
    """Matched stars of some trials.

    magnitude  (n,) G
    radius     (n,) pixel, from the middle of the frame
    error      (n, 2) pixel, centroid minus true position at the middle of the exposure
    trials     from how many trials
    """

    magnitude: Floats
    radius: Floats
    error: Floats
    trials: int


class Slew(NamedTuple):
    """Error and availability at one slew rate.

    rate      radian / second
    smear     pixel
    across    radian, rms per axis
    fraction  of trials with a correct attitude
    """

    rate: float
    smear: float
    across: Interval
    fraction: Interval


def repeat_trials(
    case: Case,
    seed: int,
    numbers: Sequence[int],
    icrs_to_camera: Rotation,
    progress: Callable[[int], None],
) -> StarErrors:
    """Repeat trials, and keep what `Outcome` does not: the error of each star.

    icrs_to_camera  the true attitude of each
    """
    rows = [np.empty((0, 4))]
    for number, attitude in zip(numbers, icrs_to_camera, strict=True):
        rows.append(_stars(case, observe(case, attitude, Streams(seed, number))))
        progress(1)
    magnitude, radius, x, y = np.concatenate(rows).T
    return StarErrors(magnitude, radius, np.column_stack([x, y]), len(numbers))


def _stars(case: Case, record: Record) -> Floats:
    """(m, 4): magnitude, radius and error of the matched stars, at the mean line of sight."""
    if not record.outcome.solved or record.outcome.false:
        return np.empty((0, 4))
    camera, matches = case.instrument.camera, record.matches
    # A centroid measures the mean position in the exposure, so the true one is at the mean line of
    # sight.
    mean = stability(record.path).mean
    turned = record.icrs_to_camera.apply(matches.direction)
    position = camera.project(turned + np.cross(mean, turned))
    spots = np.column_stack([record.spots.x, record.spots.y])[matches.spot]
    # Directions of the tracker's catalogue, so the magnitudes are looked up by direction.
    near = np.argmax(matches.direction @ record.stars.direction.T, axis=1)
    radius = np.hypot(*(position - camera.centre).T)
    return np.column_stack([record.stars.magnitude_g[near], radius, spots - position])


def slews(case: Case, seed: int, trials: int, progress: Callable[[int], None]) -> list[Slew]:
    """The same trials at other slew rates, about x, all else as in the design."""
    instrument, result = case.instrument, []
    pixel = 1 / instrument.camera.focal_length_px
    for smear in SMEARS:
        rate = smear * pixel / instrument.detector.exposure
        motion = replace(instrument.motion, rate_x=rate, rate_y=0.0, rate_z=0.0)
        turned = replace(case, instrument=replace(instrument, motion=motion))
        summary = summarise(run(turned, trials, seed, Serial(), progress=progress))
        result.append(Slew(rate, smear, summary.across, summary.availability))
    return result


def draw_stars(seen: StarErrors, half_diagonal: float) -> list[Picture]:
    """Rms centroid error per axis against magnitude and against field position."""
    pictures = []
    for at, label in (
        (seen.magnitude, "magnitude (G)"),
        (seen.radius / half_diagonal, "distance from the middle (half diagonals)"),
    ):
        figure = Figure(figsize=(WIDE, HIGH), layout="constrained")
        axes = figure.subplots()
        _binned(axes, at, seen.error)
        axes.set(xlabel=label, ylabel="centroid error, rms per axis (pixel)", yscale="log")
        pictures.append(Picture(figure, f"Centroid error of the stars over the {label}"))
    axes.set_xlim(0, 1)
    return pictures


def _binned(axes: Axes, at: Floats, error: Floats) -> None:
    """Rms in bins of equal numbers of stars, bars of 95 %."""
    order = np.argsort(at)
    count = min(BINS, len(order) // FEWEST)
    for part in np.array_split(order, count) if count else []:
        rms = rms_interval((error[part] ** 2).mean(axis=1))
        bars = [[max(rms.value - rms.low, 0)], [rms.high - rms.value]]
        axes.errorbar(float(at[part].mean()), rms.value, yerr=bars, fmt="o", ms=4, color=BLUE)
    # Rasterised, because thousands of points would make a large file.
    axes.plot(at, np.sqrt((error**2).mean(axis=1)), ".", ms=2, alpha=0.25, color=BLUE, zorder=0,
              rasterized=True)  # fmt: skip
    axes.grid(lw=0.3)


def draw_slews(slewed: Sequence[Slew], design_rate: float) -> list[Picture]:
    """Error and availability against the rate; `design_rate` in radian / second."""
    rate, pictures = np.array([one.rate for one in slewed]) / deg, []
    solved = any(one.across.value > 0 for one in slewed)
    for name, unit, label in (
        ("across", arcsec, "error across, rms per axis (arcsec)"),
        ("fraction", 0.01, "trials with a correct attitude (%)"),
    ):
        figure = Figure(figsize=(WIDE, HIGH), layout="constrained")
        axes = figure.subplots()
        value, low, high = (
            np.array([getattr(getattr(one, name), part) for one in slewed]) / unit
            for part in ("value", "low", "high")
        )
        # One trial, or none, gives no interval.
        bars = [np.where(np.isfinite(end), end, 0) for end in (value - low, high - value)]
        axes.errorbar(rate, value, yerr=bars, fmt="o-", ms=4, color=BLUE)
        axes.axvline(design_rate / deg, color=RED, lw=0.8, label="of the design")
        axes.set(xlabel="slew rate (deg / s)", ylabel=label)
        axes.set_xscale("symlog", linthresh=max(rate[1], 1e-9))
        axes.set_xlim(-0.2 * rate[1], 1.3 * rate[-1])
        axes.grid(lw=0.3)
        axes.legend(fontsize=8)
        if name == "fraction":
            axes.set_ylim(-3, 103)
        elif solved:
            axes.set_yscale("log")
        pictures.append(Picture(figure, f"{label} over the slew rate"))
    return pictures


def half_diagonal(case: Case) -> float:
    """Pixel, from the middle of the frame to its corner."""
    detector = case.instrument.detector
    return math.hypot(detector.columns, detector.rows) / 2
