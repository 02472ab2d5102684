"""Errors of many trials -> their distributions, with the intervals of their quantiles."""

from __future__ import annotations

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from startrack.campaign.precision import quantile_interval
from startrack.error import Interval
from startrack.report.inline import BLUE, GREY
from startrack.units import arcsec

Floats = NDArray[np.float64]

SHARES = (0.5, 0.68, 0.9545, 0.9973)
POINTS = 300  # of a curve


def sizes(outcomes: NDArray[np.void]) -> tuple[Floats, Floats]:
    """Radian, of the trials with a right attitude: angle across, size about the boresight."""
    right = outcomes[outcomes["solved"] & ~outcomes["false"]]
    return np.hypot(right["error_x"], right["error_y"]), np.abs(right["error_z"])


def quantiles(size: Floats) -> list[Interval]:
    """Radian, the sizes that the shares do not exceed, with 95 % intervals free of any law."""
    return [quantile_interval(size, share) for share in SHARES]


def spread(outcomes: NDArray[np.void]) -> Figure:
    """Share of trials that exceed an error, with its interval, and the normal law beside it."""
    across, about = sizes(outcomes)
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _exceedance(left, across, scipy.stats.rayleigh(scale=_rms(across) / 2**0.5))
    _exceedance(right, about, scipy.stats.halfnorm(scale=_rms(about)))
    left.set(xlabel="angle across the boresight (arcsec)", ylabel="share of trials beyond")
    right.set(xlabel="size of the error about the boresight (arcsec)")
    if len(across):
        left.legend(fontsize=8)
    return figure


def _exceedance(axes: Axes, size: Floats, law) -> None:  # type: ignore[no-untyped-def]
    n = len(size)
    if n == 0:
        axes.text(0.5, 0.5, "no right attitude", ha="center", transform=axes.transAxes)
        return
    ordered = np.sort(size)
    rank = np.unique(np.round(np.geomspace(1, n, POINTS)).astype(int))  # from the largest down
    beyond, at = (rank - 0.5) / n, ordered[n - rank] / arcsec
    # The share beyond the k-th largest of n is a beta variable.
    low, high = scipy.stats.beta.ppf([[0.025], [0.975]], rank, n - rank + 1)
    axes.fill_between(at, low, high, step="mid", color=BLUE, alpha=0.2, lw=0,
                      label="95 % interval")  # fmt: skip
    axes.plot(at, beyond, color=BLUE, lw=1.3, label=f"{n} trials")
    grid = np.linspace(0, ordered[-1], POINTS)
    axes.plot(grid / arcsec, law.sf(grid), "--", color=GREY, lw=1, label="normal law of this rms")
    axes.set_yscale("log")
    axes.set_ylim(0.3 / n, 1.2)
    axes.set_xlim(0, None)
    axes.grid(lw=0.3)


def _rms(size: Floats) -> float:
    return float(np.sqrt(np.mean(size**2))) if len(size) else 1.0
