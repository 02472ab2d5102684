"""Picture of the errors of one sequence in time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from startrack.core import arcsec, deg
from startrack.io import save_figure
from startrack.sequence import Mode

BLUE, RED, GREY = "#3567a8", "#c0392b", "#888888"
COLOURS = {
    Mode.SEARCHING: "#c0392b",
    Mode.ACQUIRED: "#8e44ad",
    Mode.TRACKED: "#2e7d5b",
    Mode.COASTED: "#e08e29",
}


def draw_sequence(path: Path, table: NDArray[np.void], title: str) -> None:
    """Rate and mode, and the error about two axes: of each frame alone and of the filter."""
    figure = Figure(figsize=(9, 7), layout="constrained", dpi=130)
    rate, across, about = figure.subplots(3, 1, sharex=True, height_ratios=(1, 2, 2))
    time = table["time"]
    rate.step(time, table["rate"] / deg, where="mid", color=GREY, lw=1)
    for mode, colour in COLOURS.items():
        here = table["mode"] == mode
        rate.plot(time[here], table["rate"][here] / deg, "o", ms=4, color=colour,
                  label=mode.name.lower())  # fmt: skip
    rate.set(ylabel="rate (deg / s)", ylim=(0, None))
    rate.legend(fontsize=8, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    _errors(across, table, "x", "error about x (arcsec)")
    _errors(about, table, "z", "error about the boresight (arcsec)")
    about.set_xlabel("time (s)")
    across.legend(fontsize=8, ncols=3)
    figure.suptitle(title, fontsize=10)
    save_figure(path, figure)


def _errors(axes: Axes, table: NDArray[np.void], axis: str, label: str) -> None:
    time = table["time"]
    filtered, sigma = (table[name + axis] / arcsec for name in ("filtered_", "filtered_sigma_"))
    axes.fill_between(time, -3 * sigma, 3 * sigma, color=BLUE, alpha=0.15, lw=0,
                      label="3 sigma that the filter states")  # fmt: skip
    axes.plot(time, table[f"error_{axis}"] / arcsec, ".", ms=4, color=RED, label="frame alone")
    axes.plot(time, filtered, "-", lw=1.2, color=BLUE, label="filter")
    known = np.abs(table[f"error_{axis}"][~table["false"]] / arcsec)
    scale = float(np.nanmax([np.nanmedian(known) * 8, 1e-3])) if np.isfinite(known).any() else 1.0
    # A coasting filter drifts by degrees; linear near zero, logarithmic beyond.
    axes.set_yscale("symlog", linthresh=scale, linscale=2)
    axes.set_ylabel(label)
    axes.axhline(0, color=GREY, lw=0.5)
