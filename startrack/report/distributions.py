"""Distributions, quantiles and sky maps of the errors of many trials."""

from __future__ import annotations

import math

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from startrack.core import Floats, arcsec
from startrack.metrics import Interval
from startrack.montecarlo import Regions, quantile_interval
from startrack.report.page import BLUE, GREY, RED

FRACTIONS = (0.5, 0.68, 0.9545, 0.9973)
POINTS = 300  # of a curve


def sizes(outcomes: NDArray[np.void]) -> tuple[Floats, Floats]:
    """Radian, of the trials with a correct attitude: angle across, size about the boresight."""
    correct = outcomes[outcomes["solved"] & ~outcomes["false"]]
    return np.hypot(correct["error_x"], correct["error_y"]), np.abs(correct["error_z"])


def quantiles(size: Floats) -> list[Interval]:
    """Radian, the quantiles of the sizes, with distribution-free 95 % intervals."""
    return [quantile_interval(size, fraction) for fraction in FRACTIONS]


def exceedance(outcomes: NDArray[np.void]) -> Figure:
    """Fraction of trials that exceed an error, with its interval, and the normal distribution."""
    across, about = sizes(outcomes)
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _exceedance(left, across, scipy.stats.rayleigh(scale=_rms(across) / 2**0.5))
    _exceedance(right, about, scipy.stats.halfnorm(scale=_rms(about)))
    left.set(xlabel="angle across the boresight (arcsec)", ylabel="fraction of trials beyond")
    right.set(xlabel="size of the error about the boresight (arcsec)")
    if len(across):
        left.legend(fontsize=8)
    return figure


def _exceedance(axes: Axes, size: Floats, law) -> None:  # type: ignore[no-untyped-def]
    n = len(size)
    if n == 0:
        axes.text(0.5, 0.5, "no correct attitude", ha="center", transform=axes.transAxes)
        return
    ordered = np.sort(size)
    rank = np.unique(np.round(np.geomspace(1, n, POINTS)).astype(int))  # from the largest down
    beyond, at = (rank - 0.5) / n, ordered[n - rank] / arcsec
    # The fraction beyond the k-th largest of n is a beta variable.
    low, high = scipy.stats.beta.ppf([[0.025], [0.975]], rank, n - rank + 1)
    axes.fill_between(at, low, high, step="mid", color=BLUE, alpha=0.2, lw=0,
                      label="95 % interval")  # fmt: skip
    axes.plot(at, beyond, color=BLUE, lw=1.3, label=f"{n} trials")
    grid = np.linspace(0, ordered[-1], POINTS)
    axes.plot(
        grid / arcsec, law.sf(grid), "--", color=GREY, lw=1, label="normal distribution of this rms"
    )
    axes.set_yscale("log")
    axes.set_ylim(0.3 / n, 1.2)
    axes.set_xlim(0, None)
    axes.grid(lw=0.3)


def _rms(size: Floats) -> float:
    return float(np.sqrt(np.mean(size**2))) if len(size) else 1.0


FEWEST = 5  # trials in a region, below which it stays blank; chosen by hand
FINE = 12  # pieces along each border of a region


def sky_map(boresight: Floats, outcomes: NDArray[np.void]) -> Figure:
    """The error of each trial at its boresight, and its rms over regions of equal area.

    boresight  (n, 3) unit vectors, ICRS axes, of the outcomes
    """
    figure = Figure(figsize=(9, 7.5), layout="constrained")
    each, mean = figure.subplots(2, 1, subplot_kw={"projection": "mollweide"})
    correct = outcomes["solved"] & ~outcomes["false"]
    square = (outcomes["error_x"] ** 2 + outcomes["error_y"] ** 2) / 2
    error = np.sqrt(square) / arcsec
    scale = _scale(error[correct])
    x, y = _plane(boresight)
    points = each.scatter(x[correct], y[correct], c=error[correct], s=9, norm=scale, cmap="viridis",
                          rasterized=len(outcomes) > 3000)  # fmt: skip
    each.scatter(x[~correct], y[~correct], marker="x", s=30, color=RED, label="no correct attitude")
    if not correct.all():
        each.legend(loc="lower right", fontsize=8)
    each.set_title(f"each of {len(outcomes)} trials at its boresight", fontsize=9)
    regions = Regions()
    rms = _cell_rms(regions, regions.of(boresight[correct]), square[correct])
    _regions(mean, regions, rms / arcsec, scale)
    mean.set_title(f"rms per axis in {len(regions)} regions of equal area; blank: fewer than "
                   f"{FEWEST} trials", fontsize=9)  # fmt: skip
    bar = figure.colorbar(points, ax=[each, mean], shrink=0.6)
    bar.set_label("error across the boresight (arcsec)")
    for axes in (each, mean):
        _graticule(axes)
    return figure


def _scale(error: Floats) -> LogNorm:
    low, high = np.quantile(error, [0.02, 0.98]) if len(error) else (0.1, 1.0)
    return LogNorm(max(low, 1e-6), max(high, 2e-6, 1.01 * low))


def _plane(direction: Floats) -> tuple[Floats, Floats]:
    """Longitude and latitude on the map: right ascension grows to the left, 12 h at the edge."""
    x, y, z = direction.T
    return -np.arctan2(y, x), np.arcsin(np.clip(z, -1, 1))


def _cell_rms(regions: Regions, cell: NDArray[np.int64], square: Floats) -> Floats:
    count = np.bincount(cell, minlength=len(regions))
    total = np.bincount(cell, square, minlength=len(regions))
    mean = np.divide(total, count, out=np.full(len(regions), np.nan), where=count >= FEWEST)
    return np.asarray(np.sqrt(mean))


def _regions(axes: Axes, regions: Regions, value: Floats, scale: LogNorm) -> None:
    # From 12 h over 0 h to 12 h, edge to edge; drawn finely, because borders are curved.
    cells = np.roll(value.reshape(regions.bands, regions.sectors), regions.sectors // 2, axis=1)
    fine = cells.repeat(FINE, axis=0).repeat(FINE, axis=1)
    ra, dec = Regions(regions.bands * FINE, regions.sectors * FINE).corners()
    axes.pcolormesh(math.pi - ra, dec, fine, norm=scale, cmap="viridis", rasterized=True)


def _graticule(axes: Axes) -> None:
    hours = np.arange(-150, 151, 60)
    axes.set_xticks(np.radians(hours), [f"{int(-h % 360) // 15} h" for h in hours])
    axes.set_yticks(np.radians([-60, -30, 0, 30, 60]))
    axes.grid(lw=0.3)
    axes.tick_params(labelsize=7)
