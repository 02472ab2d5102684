"""Pictures of Earth scenes: geometry over the image; image and radiance."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.io import save_figure


def draw_geometry(path: Path, maps: dict[str, Floats], title: str) -> None:
    """Write the picture.

    maps  (lines, columns) each: height in metre, shadow as a fraction, incidence in degree, level
    """
    figure = Figure(figsize=(10, 9), layout="constrained", dpi=110)
    axes = figure.subplots(2, 2)
    _panel(figure, axes[0, 0], maps["height"], "height above the ellipsoid (m)", "terrain")
    _panel(figure, axes[0, 1], maps["shadow"], "fraction in shadow", "gray_r", 0, 1)
    _panel(figure, axes[1, 0], maps["incidence"], "incidence of the line of sight (deg)", "magma")
    _levels(figure, axes[1, 1], np.where(maps["hit"] > 0, maps["level"], np.nan))
    figure.suptitle(f"{title}: {maps['height'].shape[1]} x {maps['height'].shape[0]} pixel")
    save_figure(path, figure)


def draw_picture(
    path: Path, numbers: NDArray[np.integer], terms: Mapping[str, NDArray[np.floating]], title: str
) -> None:
    """Write a camera's image beside the five terms of the radiance before its lens.

    numbers  (lines, columns) digital number, its contrast stretched over 1 to 99 %
    terms    (lines, columns) each, watt / m^2 / sr / um, each with its own scale
    """
    figure = Figure(figsize=(12, 7.5), layout="constrained", dpi=110)
    axes = figure.subplots(2, 3)
    low, high = np.percentile(numbers, (1, 99))
    _panel(
        figure, axes[0, 0], numbers.astype(np.float64), "digital number", "gray",
        low, max(high, low + 1),
    )  # fmt: skip
    for each, (name, values) in zip(axes.ravel()[1:], terms.items(), strict=True):
        top = float(np.percentile(values, 99.8))
        label = f"{name} (W m$^{{-2}}$ sr$^{{-1}}$ $\\mu$m$^{{-1}}$)"
        _panel(figure, each, values.astype(np.float64), label, "inferno", 0, top or 1)
    figure.suptitle(title)
    save_figure(path, figure)


def _panel(
    figure: Figure, axes: Axes, values: Floats, label: str, colours: str,
    low: float | None = None, high: float | None = None,
) -> None:  # fmt: skip
    shown = axes.imshow(values, cmap=colours, vmin=low, vmax=high, interpolation="nearest")
    axes.set(xlabel="column (pixel)", ylabel="line")
    axes.set_facecolor("#c8d8e8")  # the sky
    figure.colorbar(shown, ax=axes, label=label, shrink=0.85)


def _levels(figure: Figure, axes: Axes, level: Floats) -> None:
    most = int(np.nanmax(level)) if np.isfinite(level).any() else 0
    norm = BoundaryNorm(np.arange(-0.5, most + 1.5), 256)
    shown = axes.imshow(level, cmap="viridis", norm=norm, interpolation="nearest")
    axes.set(xlabel="column (pixel)", ylabel="line")
    axes.set_facecolor("#c8d8e8")
    figure.colorbar(
        shown, ax=axes, label="level of the pyramid", ticks=range(most + 1), shrink=0.85
    )
