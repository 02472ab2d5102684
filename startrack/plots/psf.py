"""The picture of a PSF: the image of a star over its pixels, and its modulation transfer."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from startrack.core import Floats, Psf
from startrack.plots import style

Curves = dict[str, Floats]

FAINTEST = -5.0  # decades below the peak
ALIKE = 1e-3  # of the modulation; curves along x and y that differ by less are drawn as one
LOOKS = {
    "optics": (style.BLUE, "o"),
    "blur in optics": (style.PURPLE, "D"),
    "pixel": (style.GREEN, "s"),
    "diffusion": (style.RED, "v"),
    "motion": (style.ORANGE, "^"),
    "total": (style.BLACK, ""),
}


@style.styled
def draw_psf(
    path: Path, image: Psf, frequency: Floats, curves: Sequence[Curves], title: str
) -> None:
    """Write the picture.

    image      the image of a point before the pixels
    frequency  (n,) cycle / pixel
    curves     of the modulation over it, along x and along y
    """
    figure = style.picture(9.4, title)
    above, below = figure.subplots(2, 1, height_ratios=(1.5, 1))
    _spot(above, image)
    _modulation(below, frequency, curves)
    style.save_picture(path, figure)


def _spot(axes: Axes, image: Psf) -> None:
    table = image.table / image.table.max()
    decades = np.log10(np.maximum(table, 10.0 ** (FAINTEST - 1)))
    edge = (table.shape[0] / 2) / image.oversampling
    shown = axes.imshow(
        decades, extent=(-edge, edge, edge, -edge), cmap="magma", vmin=FAINTEST, vmax=0
    )
    lines = np.arange(np.ceil(-edge - 0.5) + 0.5, edge, 1.0)
    axes.set_xticks(lines, minor=True)
    axes.set_yticks(lines, minor=True)
    axes.grid(visible=False)
    axes.grid(which="minor", color="white", alpha=0.35, lw=0.6)
    axes.tick_params(which="minor", length=0)
    axes.set(xlabel="x (pixel)", ylabel="y (pixel)", xlim=(-edge, edge), ylim=(edge, -edge))
    style.panel_title(axes, "image of a star before the pixels; lines: borders of pixels", 52)
    bar = style.colour_bar(shown, axes, decades, "irradiance over its peak (ratio)")
    ticks = np.arange(FAINTEST, 1)
    bar.set_ticks(ticks.tolist(), labels=[style.plain(10.0**tick) for tick in ticks])


def _modulation(axes: Axes, frequency: Floats, curves: Sequence[Curves]) -> None:
    along_x, along_y = curves
    alike = all(np.abs(along_x[name] - along_y[name]).max() < ALIKE for name in along_x)
    every = max(1, len(frequency) // 8)
    directions = ((along_x, "-", "x"), (along_y, "--", "y"))
    for curve, dashes, direction in directions[:1] if alike else directions:
        for name, values in curve.items():
            colour, marker = LOOKS[name]
            axes.plot(
                frequency[1:],
                values[1:],
                dashes,
                color=colour,
                marker=marker,
                markevery=every,
                ms=4,
                lw=2.0 if name == "total" else 1.2,
                label=name if direction == "x" else None,
            )
    text = "the same along x and y"
    if not alike:
        axes.plot([], [], "--", color="gray", label="dashed: along y")
        text = "along x and along y"
    axes.set(xlim=(0, frequency[-1]), ylim=(0, 1.02))
    axes.set(xlabel="frequency (cycle / pixel), to Nyquist's", ylabel="modulation (ratio)")
    style.panel_title(axes, f"modulation transfer, {text}")
    style.legend_below(axes, 4)
