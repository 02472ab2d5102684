"""Pictures of Earth scenes: geometry over the image; image and radiance."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.plots.style import (
    colour_bar,
    colour_limits,
    picture,
    save_picture,
    say,
    styled,
)

SKY_COLOUR = "#c8d8e8"
BRIGHTEST = 0.998  # of the pixels have a colour of their own
BETWEEN = (0.01, 0.99)  # of the pixels, the image's contrast


@styled
def draw_geometry(path: Path, maps: dict[str, Floats], title: str) -> None:
    """Write the picture.

    maps  (lines, columns) each: height in metre, shadow as a fraction, incidence in degree, level
    """
    lines, columns = maps["height"].shape
    figure = picture(8.0, f"{title}: {columns} x {lines} pixel; light blue: sky, no ground")
    axes = figure.subplots(2, 2)
    _panel(axes[0, 0], maps["height"], "height above the ellipsoid (m)", "cividis")
    _panel(axes[0, 1], maps["shadow"], "shadow (fraction of the pixel)", "gray_r", (0.0, 1.0))
    _panel(axes[1, 0], maps["incidence"], "incidence of the line of sight (deg)", "magma")
    _levels(axes[1, 1], np.where(maps["hit"] > 0, maps["level"], np.nan))
    save_picture(path, figure)


@styled
def draw_picture(
    path: Path, numbers: NDArray[np.integer], terms: Mapping[str, NDArray[np.floating]], title: str
) -> None:
    """Write a camera's image beside the five terms of the radiance before its lens.

    numbers  (lines, columns) digital number, its contrast stretched over 1 to 99 %
    terms    (lines, columns) each, watt / m^2 / sr / um, each with its own scale
    """
    figure = picture(11.5, title)
    axes = figure.subplots(3, 2).ravel()
    values = numbers.astype(np.float64)
    low, high = np.quantile(values, BETWEEN)
    _panel(axes[0], values, "image (digital number)", "gray", (low, max(high, low + 1)))
    for each, (name, term) in zip(axes[1:], terms.items(), strict=True):
        label = f"{name} (W m$^{{-2}}$ sr$^{{-1}}$ $\\mu$m$^{{-1}}$)"
        values = term.astype(np.float64)
        _panel(each, values, label, "inferno", colour_limits(values, BRIGHTEST, 0.0))
    save_picture(path, figure)


def _panel(
    axes: Axes, values: Floats, label: str, colours: str, limits: tuple[float, float] | None = None
) -> None:
    low, high = limits or colour_limits(values)
    shown = axes.imshow(values, cmap=colours, vmin=low, vmax=high, interpolation="nearest")
    _axes(axes)
    colour_bar(shown, axes, values, label, orientation="horizontal", aspect=22)
    known = values[np.isfinite(values)]
    if not len(known):
        say(axes, "no ground in the image")
    elif known.min() == known.max():
        say(axes, f"{known[0]:g} everywhere")


def _levels(axes: Axes, level: Floats) -> None:
    most = int(np.nanmax(level)) if np.isfinite(level).any() else 0
    norm = BoundaryNorm(np.arange(-0.5, most + 1.5), 256)
    shown = axes.imshow(level, cmap="viridis", norm=norm, interpolation="nearest")
    _axes(axes)
    colour_bar(
        shown, axes, level, "level of the terrain's pyramid (number)", ticks=range(most + 1),
        orientation="horizontal", aspect=22,
    )  # fmt: skip


def _axes(axes: Axes) -> None:
    axes.set(xlabel="column (pixel)", ylabel="line (pixel)")
    axes.set_facecolor(SKY_COLOUR)
    axes.grid(visible=False)
