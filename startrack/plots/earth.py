"""Pictures of Earth scenes: geometry over the image; image and radiance."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.plots import style

SKY_COLOUR = "#c8d8e8"
BRIGHTEST = 0.998  # of the pixels have a colour of their own
FLAGS = (
    style.RED,
    style.BLUE,
    style.ORANGE,
    style.PURPLE,
    style.SKY,
    style.GREEN,
)  # of the quality bits, after the colour of no data
BELOW: Any = {"orientation": "horizontal", "aspect": 22}  # the scale of colours
BETWEEN = (0.01, 0.99)  # of the pixels, the image's contrast


@style.styled
def draw_geometry(path: Path, maps: dict[str, Floats], title: str) -> None:
    """Write the picture.

    maps  (lines, columns) each: height in metre, shadow as a fraction, incidence in degree, level
    """
    lines, columns = maps["height"].shape
    figure = style.picture(8.0, f"{title}: {columns} x {lines} pixel; light blue: sky, no ground")
    axes = figure.subplots(2, 2)
    _panel(axes[0, 0], maps["height"], "height above the ellipsoid (m)", "cividis")
    _panel(axes[0, 1], maps["shadow"], "shadow (fraction of the pixel)", "gray_r", (0.0, 1.0))
    _panel(axes[1, 0], maps["incidence"], "incidence of the line of sight (deg)", "magma")
    _levels(axes[1, 1], np.where(maps["hit"] > 0, maps["level"], np.nan))
    style.save_picture(path, figure)


@style.styled
def draw_spectrum(
    path: Path,
    wavelength: Floats,
    radiance: Floats,
    scattered: Floats,
    bands: Sequence[tuple[str, float, float, float]],
) -> None:
    """Write the picture of a spectrum at the sensor, with a rectangle for each band.

    wavelength           (n,) metre
    radiance, scattered  (n,) watt / m^2 / sr / um, of all light and of the air over black ground
    bands                name, metre from and to, watt / m^2 / sr / um
    """
    figure = style.picture(4.5, "spectrum at the sensor; rectangles: bands of the channels")
    axes = figure.subplots()
    axes.plot(1e9 * wavelength, radiance, color=style.BLUE, lw=0.8, label="ground and air")
    axes.plot(1e9 * wavelength, scattered, color=style.ORANGE, lw=0.8, label="air alone")
    named: dict[tuple[float, float, float], list[str]] = {}  # channels may share a band
    for name, *band in bands:
        named.setdefault((band[0], band[1], band[2]), []).append(name)
    for (low, high, mean), names in named.items():
        ends = np.array([low, low, high, high]) * 1e9
        axes.plot(ends, [0, mean, mean, 0], color=style.GREEN, lw=1.2)
        text = ", ".join(names)
        axes.annotate(text, (ends[1:3].mean(), mean), ha="center", va="bottom", fontsize=7)
    label = "spectral radiance (W / m$^2$ / sr / um)"
    axes.set(xlabel="wavelength (nm)", ylabel=label, ylim=(0, None))
    axes.legend()
    style.save_picture(path, figure)


@style.styled
def draw_picture(
    path: Path, numbers: NDArray[np.integer], terms: Mapping[str, NDArray[np.floating]], title: str
) -> None:
    """Write a camera's image beside the five terms of the radiance before its lens.

    numbers  (lines, columns) digital number, its contrast stretched over 1 to 99 %
    terms    (lines, columns) each, watt / m^2 / sr / um, each with its own scale
    """
    figure = style.picture(11.5, title)
    axes = figure.subplots(3, 2).ravel()
    values = numbers.astype(np.float64)
    low, high = np.quantile(values, BETWEEN)
    _panel(axes[0], values, "image (digital number)", "gray", (low, max(high, low + 1)))
    for panel, (name, term) in zip(axes[1:], terms.items(), strict=True):
        label = f"{name} (W m$^{{-2}}$ sr$^{{-1}}$ $\\mu$m$^{{-1}}$)"
        values = term.astype(np.float64)
        _panel(panel, values, label, "inferno", style.colour_limits(values, BRIGHTEST, 0.0))
    style.save_picture(path, figure)


@style.styled
def draw_product(
    path: Path,
    layers: Mapping[str, Floats],
    units: Mapping[str, str],
    quality: NDArray[np.uint8],
    names: Mapping[str, int],
    title: str,
) -> None:
    """Write the layers of a product on its map, and the quality of its cells.

    layers   (rows, columns) each; NaN where there is nothing
    units    of each layer, "1" for none
    quality  (rows, columns) bits
    names    the meaning of each bit; a cell has the colour of its highest one
    """
    rows = -(-(len(layers) + 1) // 2)
    tall = min(quality.shape[0] / quality.shape[1], 1.5)
    figure = style.picture(0.4 + rows * (1.15 + 2.6 * tall), title)
    axes = figure.subplots(rows, 2, squeeze=False).ravel()
    for panel, (name, values) in zip(axes, layers.items(), strict=False):
        label = name if units[name] == "1" else f"{name} ({units[name]})"
        finite = values[np.isfinite(values)]
        low, high = np.quantile(finite, BETWEEN) if len(finite) else (0.0, 0.0)
        _panel(panel, values, label, "gray", (low, high) if low < high else None)
    _flags(axes[len(layers)], quality, names)
    for panel in axes[: len(layers) + 1]:
        panel.set(xlabel="column (cell)", ylabel="row (cell)")
    for panel in axes[len(layers) + 1 :]:
        panel.set_visible(False)
    style.save_picture(path, figure)


def _flags(axes: Axes, quality: NDArray[np.uint8], names: Mapping[str, int]) -> None:
    colours = ["white", "0.8", *FLAGS][: len(names) + 1]
    shown = np.zeros(quality.shape)
    for n, bit in enumerate(names.values(), 1):
        shown[quality & bit > 0] = n
    norm = BoundaryNorm(np.arange(-0.5, len(names) + 1), len(names) + 1)
    image = axes.imshow(shown, cmap=ListedColormap(colours), norm=norm, interpolation="nearest")
    _axes(axes)
    bar = style.colour_bar(image, axes, shown, "quality", ticks=range(len(names) + 1), **BELOW)
    bar.set_ticklabels(["good", *names], rotation=30, ha="right")


def _panel(
    axes: Axes, values: Floats, label: str, colours: str, limits: tuple[float, float] | None = None
) -> None:
    low, high = limits or style.colour_limits(values)
    shown = axes.imshow(values, cmap=colours, vmin=low, vmax=high, interpolation="nearest")
    _axes(axes)
    style.colour_bar(shown, axes, values, label, **BELOW)
    finite = values[np.isfinite(values)]
    if not len(finite):
        style.say(axes, "no ground in the image")
    elif finite.min() == finite.max():
        style.say(axes, f"{finite[0]:g} everywhere")


def _levels(axes: Axes, level: Floats) -> None:
    most = int(np.nanmax(level)) if np.isfinite(level).any() else 0
    norm = BoundaryNorm(np.arange(-0.5, most + 1.5), 256)
    shown = axes.imshow(level, cmap="viridis", norm=norm, interpolation="nearest")
    _axes(axes)
    label = "level of the terrain's pyramid (number)"
    style.colour_bar(shown, axes, level, label, ticks=range(most + 1), **BELOW)


def _axes(axes: Axes) -> None:
    axes.set(xlabel="column (pixel)", ylabel="line (pixel)")
    axes.set_facecolor(SKY_COLOUR)
    axes.grid(visible=False)
