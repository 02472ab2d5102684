"""Errors of stars against magnitude and field position; of the attitude against slew rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import chain, repeat
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
from startrack.plots import (
    BLACK,
    BLUE,
    LONGEST,
    RED,
    SMEARS,
    Curve,
    analytic_curve,
    legend_below,
    slew_rates,
    slewing,
    styled,
)
from startrack.report.page import HIGH, WIDE, Picture
from startrack.trial import Record, observe

BINS = 8
FEWEST = 8  # stars in a bin, at least; chosen by hand


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
    result = []
    for smear, rate in zip(SMEARS, slew_rates(case).tolist(), strict=True):
        turned = slewing(case, rate)
        summary = summarise(run(turned, trials, seed, Serial(), progress=progress))
        result.append(Slew(rate, smear, summary.across, summary.availability))
    return result


def formula(case: Case) -> Curve:
    """The analytic budget at the rates of a smear that it takes seconds for."""
    return analytic_curve(case, slew_rates(case, LONGEST))


@styled
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
        legend_below(axes, 1)
        pictures.append(Picture(figure, f"Centroid error of the stars over the {label}"))
    axes.set_xlim(0, 1)
    return pictures


def _binned(axes: Axes, at: Floats, error: Floats) -> None:
    """Rms in bins of equal numbers of stars, bars of 95 %."""
    order = np.argsort(at)
    count = min(BINS, len(order) // FEWEST)
    named = chain(["rms in bins of equal numbers, 95 %"], repeat(None))
    for part in np.array_split(order, count) if count else []:
        rms = rms_interval((error[part] ** 2).mean(axis=1))
        bars = [[max(rms.value - rms.low, 0)], [rms.high - rms.value]]
        axes.errorbar(
            float(at[part].mean()), rms.value, yerr=bars, fmt="o", ms=5, color=BLACK, mfc="white",
            zorder=3, label=next(named),
        )  # fmt: skip
    # Rasterised, because thousands of points would make a large file.
    axes.plot(at, np.sqrt((error**2).mean(axis=1)), ".", ms=3, alpha=0.3, color=BLUE, zorder=0,
              rasterized=True, label=f"each of {len(at)} stars")  # fmt: skip


@styled
def draw_slews(
    slewed: Sequence[Slew], design_rate: float, expected: Curve | None = None
) -> list[Picture]:
    """Error and availability against the rate; `design_rate` in radian / second."""
    rate, pictures = np.array([one.rate for one in slewed]) / deg, []
    solved = any(one.across.value > 0 for one in slewed)
    for name, other, unit, label in (
        ("across", "across", arcsec, "error across, rms per axis (arcsec)"),
        ("fraction", "available", 0.01, "trials with a correct attitude (%)"),
    ):
        figure = Figure(figsize=(WIDE, HIGH), layout="constrained")
        axes = figure.subplots()
        value, low, high = (
            np.array([getattr(getattr(one, name), part) for one in slewed]) / unit
            for part in ("value", "low", "high")
        )
        if expected and any(expected.budgets):
            _shade(axes, expected)
            axes.plot(expected.rate / deg, getattr(expected, other) / unit, "--", color=RED,
                      label="analytic budget")  # fmt: skip
        # One trial, or none, gives no interval.
        bars = [np.where(np.isfinite(end), end, 0) for end in (value - low, high - value)]
        axes.errorbar(rate, value, yerr=bars, fmt="o-", ms=4, color=BLUE, label="trials, 95 %")
        axes.axvline(design_rate / deg, color=BLACK, lw=1, ls=":", label="rate of the design")
        axes.set(xlabel="slew rate (deg / s)", ylabel=label)
        axes.set_xscale("symlog", linthresh=max(rate[1], 1e-9))
        axes.set_xlim(-0.2 * rate[1], 1.3 * max(rate[-1], design_rate / deg))
        if name == "fraction":
            axes.set_ylim(-3, 103)
        elif solved:
            axes.set_yscale("log")
        legend_below(axes, 1)
        pictures.append(Picture(figure, f"{label} over the slew rate"))
    return pictures


def _shade(axes: Axes, expected: Curve) -> None:
    """Rates at which the formula leaves out more than at rest."""
    first = expected.first_left_out
    if first is not None:
        axes.axvspan(expected.rate[first] / deg, 1.3 * expected.rate[-1] / deg, color="0.9",
                     zorder=0, label="rates with effects that the budget leaves out")  # fmt: skip


def half_diagonal(case: Case) -> float:
    """Pixel, from the middle of the frame to its corner."""
    detector = case.instrument.detector
    return math.hypot(detector.columns, detector.rows) / 2
