"""The picture of a PSF: the image of a star over its pixels, and its modulation transfer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from startrack.core import Psf
from startrack.io import save_figure

Curves = dict[str, NDArray[np.float64]]

FAINTEST = -5.0  # decades below the peak
COLOURS = {
    "optics": "#3567a8",
    "blur in optics": "#8a6fb0",
    "pixel": "#2e7d5b",
    "diffusion": "#c0392b",
    "motion": "#d08a2e",
    "total": "#222222",
}


def draw_psf(
    path: Path, image: Psf, frequency: NDArray[np.float64], curves: Sequence[Curves], title: str
) -> None:
    """Write the picture.

    image      the image of a point before the pixels
    frequency  (n,) cycle / pixel
    curves     of the modulation over it, along x and along y
    """
    figure = Figure(figsize=(10, 4.8), layout="constrained", dpi=130)
    left, right = figure.subplots(1, 2, width_ratios=(1.1, 1))
    _spot(left, image, figure)
    _modulation(right, frequency, curves)
    figure.suptitle(title, fontsize=10)
    save_figure(path, figure)


def _spot(axes: Axes, image: Psf, figure: Figure) -> None:
    table = image.table / image.table.max()
    decades = np.log10(np.maximum(table, 10**FAINTEST))
    edge = (table.shape[0] / 2) / image.oversampling
    shown = axes.imshow(
        decades, extent=(-edge, edge, edge, -edge), cmap="magma", vmin=FAINTEST, vmax=0
    )
    lines = np.arange(np.ceil(-edge - 0.5) + 0.5, edge, 1.0)
    axes.set_xticks(lines, minor=True)
    axes.set_yticks(lines, minor=True)
    axes.grid(which="minor", color="white", alpha=0.35, lw=0.6)
    axes.tick_params(which="minor", length=0)
    axes.set(xlabel="x (pixel)", ylabel="y (pixel)", xlim=(-edge, edge), ylim=(edge, -edge))
    axes.set_title("image of a star, and pixels", fontsize=9)
    figure.colorbar(shown, ax=axes, label="log10(irradiance / peak)", shrink=0.85)


def _modulation(axes: Axes, frequency: NDArray[np.float64], curves: Sequence[Curves]) -> None:
    for curve, style, direction in zip(curves, ("-", "--"), ("x", "y"), strict=True):
        for name, values in curve.items():
            width = 2.0 if name == "total" else 1.2
            label = name if direction == "x" else None
            axes.plot(frequency[1:], values[1:], style, color=COLOURS[name], lw=width, label=label)
    axes.plot([], [], "--", color="gray", label="along y")
    axes.set(xlim=(0, frequency[-1]), ylim=(0, 1.02))
    axes.set(xlabel="frequency (cycle / pixel, to Nyquist)", ylabel="modulation")
    axes.set_title("modulation transfer, along x and along y", fontsize=9)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
