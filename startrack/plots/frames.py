"""Pictures of frames and solutions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import FuncNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.path import Path as MarkerPath
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Flags, Floats, Frame, Matches, Spots, Stars, arcsec, deg
from startrack.plots import style

IMAGE = 5.75  # inch, width of the image beside its axis
LABELS = 10  # brightest stars whose name or magnitude is written beside them
LETTER_WIDTH, LETTER_HEIGHT = 0.068, 0.14  # inch, of a label's letters of 8.5 points
RING = 0.075  # inch, half the side of the mark of a spot
SCALES = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 2 * 3600, 5 * 3600, 36000)
# Four arms around a place that stays free, so that its star is seen.
CROSS = MarkerPath(
    [(0.5, 0), (1, 0), (-0.5, 0), (-1, 0), (0, 0.5), (0, 1), (0, -0.5), (0, -1)],
    [MarkerPath.MOVETO, MarkerPath.LINETO] * 4,
)
RINGS: dict[str, Any] = {"s": 70, "facecolors": "none", "linewidths": 1.2}

# Proper names by Hipparcos number, of the stars that are too bright for Gaia: the shipped catalogue
# has them from Hipparcos. Source: Catalog of Star Names of the IAU's Working Group on Star Names
# (2022-04-04).
PROPER_NAMES = {
    677: "Alpheratz", 3419: "Diphda", 5447: "Mirach", 7588: "Achernar", 8903: "Sheratan",
    9640: "Almach", 9884: "Hamal", 11767: "Polaris", 14135: "Menkar", 14576: "Algol",
    15863: "Mirfak", 21421: "Aldebaran", 24436: "Rigel", 24608: "Capella", 25336: "Bellatrix",
    25428: "Elnath", 26311: "Alnilam", 26727: "Alnitak", 27989: "Betelgeuse", 28360: "Menkalinan",
    28380: "Mahasim", 30324: "Mirzam", 30438: "Canopus", 31681: "Alhena", 32349: "Sirius",
    33579: "Adhara", 34444: "Wezen", 36850: "Castor", 37279: "Procyon", 37826: "Pollux",
    41037: "Avior", 42913: "Alsephina", 44816: "Suhail", 45238: "Miaplacidus", 46390: "Alphard",
    49669: "Regulus", 50583: "Algieba", 54061: "Dubhe", 57632: "Denebola", 59803: "Gienah",
    60718: "Acrux", 61084: "Gacrux", 62434: "Mimosa", 65474: "Spica", 68702: "Hadar",
    68933: "Menkent", 69673: "Arcturus", 71681: "Toliman", 71683: "Rigil Kentaurus",
    72607: "Kochab", 78401: "Dschubba", 80763: "Antares", 82273: "Atria", 84345: "Rasalgethi",
    85696: "Lesath", 85927: "Shaula", 86228: "Sargas", 87833: "Eltanin", 90185: "Kaus Australis",
    91262: "Vega", 92855: "Nunki", 97649: "Altair", 100751: "Peacock", 102098: "Deneb",
    107315: "Enif", 112122: "Tiaki", 113368: "Fomalhaut", 113881: "Scheat",
}  # fmt: skip


@style.styled
def draw_frame(
    path: Path | None,
    frame: Frame,
    title: str = "",
    camera: Camera | None = None,
    icrs_to_camera: Rotation | None = None,
    stars: Stars | None = None,
    saturation: float | None = None,
) -> Figure:
    """The image with a non-linear scale that shows faint stars.

    camera, icrs_to_camera, stars  for north, scale and names of bright stars, where known
    saturation                     digital number from which on pixels are saturated
    """
    figure, axes = _image(frame, title, saturation)
    if camera is not None and icrs_to_camera is not None:
        if stars is not None:
            pixel, bright = _predicted(camera, icrs_to_camera, stars, LABELS)
            _name(axes, camera, pixel, bright, pixel)
        _compass(axes, camera, icrs_to_camera)
    return style.save_picture(path, figure)


@style.styled
def draw_spots(path: Path | None, frame: Frame, spots: Spots, title: str) -> Figure:
    """The image with a ring about each spot, the brightest numbered as in the table."""
    figure, axes = _image(frame, title)
    axes.scatter(
        spots.x, spots.y, edgecolors=style.SKY, label="spot, numbered by brightness", **RINGS
    )
    places = np.column_stack([spots.x, spots.y])[:LABELS]
    marks = np.column_stack([spots.x, spots.y])
    _label(axes, frame.image.shape, places, [str(n + 1) for n in range(len(places))], marks)
    if len(spots):
        style.legend_below(axes)
    else:
        style.say(axes, "no spot", y=0.96)
    return style.save_picture(path, figure)


@style.styled
def draw_solution(
    path: Path | None,
    frame: Frame,
    spots: Spots,
    matches: Matches,
    icrs_to_camera: Rotation | None,
    stars: Stars,
    title: str,
    saturation: float | None = None,
) -> Figure:
    """The image with its spots, matched and not, and stars of the catalogue.

    saturation  digital number from which on pixels are saturated
    """
    figure, axes = _image(frame, title, saturation)
    matched = np.zeros(len(spots), bool)
    matched[matches.spot] = True
    for chosen, colour, marker, label in (
        (matched, style.SKY, "o", "spot, matched"),
        (~matched, style.ORANGE, "s", "spot, not matched"),
    ):
        axes.scatter(
            spots.x[chosen],
            spots.y[chosen],
            edgecolors=colour,
            marker=marker,
            label=f"{label} ({chosen.sum()})",
            **RINGS,
        )
    if icrs_to_camera is not None:
        most = 2 * len(spots) + 10
        pixel, bright = _predicted(matches.camera, icrs_to_camera, stars, most)
        axes.scatter(
            pixel[:, 0],
            pixel[:, 1],
            marker=CROSS,
            s=130,
            c=style.YELLOW,
            linewidths=1.0,
            label=f"catalogue star (brightest {len(pixel)})",
        )
        marks = np.vstack([pixel, np.column_stack([spots.x, spots.y])])
        _name(axes, matches.camera, pixel, bright, marks)
        _compass(axes, matches.camera, icrs_to_camera)
    style.legend_below(axes)
    return style.save_picture(path, figure)


def _image(frame: Frame, title: str, saturation: float | None = None) -> tuple[Figure, Axes]:
    """The frame with its scale of digital numbers below it."""
    rows, columns = frame.image.shape
    shown = stretch(frame.image, saturation)
    high = min(max(IMAGE * rows / columns, 1.0), 4 * style.WIDE)
    figure = style.picture(high + 1.35 + 0.17 * style.lines_of(title), title)
    axes = figure.subplots()
    side = shown.block
    drawn = axes.imshow(
        shown.image,
        norm=shown.norm,
        cmap=colormaps["gray"].with_extremes(under="black", over="white"),
        # Whole blocks; the last ones may reach beyond the frame.
        extent=(-0.5, side * shown.image.shape[1] - 0.5, side * shown.image.shape[0] - 0.5, -0.5),
        interpolation="nearest",
    )
    if shown.saturated:
        axes.imshow(
            np.where(shown.image >= shown.saturation, 1.0, np.nan),
            cmap=ListedColormap([style.RED]),
            extent=drawn.get_extent(),
            interpolation="nearest",
        )
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
    axes.set(xlabel="x, column (pixel)", ylabel="y, row (pixel)")
    axes.grid(visible=False)
    bar = style.colour_bar(
        drawn,
        axes,
        shown.image[np.isfinite(shown.image)],
        _scale_label(shown, rows * columns),
        orientation="horizontal",
        fraction=0.03,
        aspect=40,
        pad=0.02,
    )
    ticks = [float(f"{value:.2g}") for value in shown.number(np.array([0.35, 0.6, 0.8]))]
    inside = [value for value in ticks if shown.black < value < shown.white]
    bar.set_ticks([shown.black, *inside, shown.white])
    bar.set_ticklabels([style.number(value) for value in (shown.black, *inside, shown.white)])
    low, high = np.nanmin(frame.image), np.nanmax(frame.image)
    if low == high:
        style.say(axes, f"all pixels have the digital number {low:g}")
    return figure, axes


def _scale_label(shown: Stretch, pixels: int) -> str:
    text = "digital number"
    if shown.block > 1:
        text += f", largest of each {shown.block} x {shown.block} pixels"
    if shown.wider:
        text += ", bright ones drawn 3 times as wide"
    if shown.saturated:
        text += "\n" if shown.wider else "; "
        share = 100 * shown.saturated / pixels
        text += f"red: saturated, {shown.saturated} pixels ({style.number(share)} %)"
    return text


def _predicted(
    camera: Camera, icrs_to_camera: Rotation, stars: Stars, most: int
) -> tuple[Floats, Stars]:
    """The brightest stars in the frame, at most `most`: their pixels (n, 2), and the stars."""
    direction = icrs_to_camera.apply(stars.direction)
    near = np.flatnonzero(direction[:, 2] > math.cos(camera.half_diagonal))
    pixel = camera.project(direction[near])
    inside = camera.holds(pixel)
    order = np.argsort(stars.magnitude_g[near][inside])[:most]
    return pixel[inside][order], stars[near[inside][order]]


def _name(axes: Axes, camera: Camera, pixel: Floats, stars: Stars, marks: Floats) -> None:
    """Write proper names or magnitudes beside the brightest stars, away from all marks."""
    texts = []
    for identifier, magnitude in zip(stars.identifier, stars.magnitude_g, strict=True):
        own = PROPER_NAMES.get(-int(identifier))
        texts.append(f"{own}, G {magnitude:.1f}" if own else f"G {magnitude:.1f}")
    _label(axes, (camera.rows, camera.columns), pixel[:LABELS], texts[:LABELS], marks)


def _label(
    axes: Axes, shape: tuple[int, ...], places: Floats, texts: Sequence[str], marks: Floats
) -> None:
    """Write each text beside its place, on a free side inside the frame; omit it where none is
    free.

    marks  (m, 2) pixels of all marks in the frame, which no text may hide
    """
    rows, columns = shape[:2]
    inch = columns / IMAGE  # pixel
    high, away = LETTER_HEIGHT * inch, RING * inch
    taken = [_Box(x - away, y - away, x + away, y + away) for x, y in marks.tolist()]
    frame = _Box(0, 0, columns, rows)
    for (x, y), text in zip(places.tolist(), texts, strict=True):
        wide, beside = len(text) * LETTER_WIDTH * inch, RING * inch
        for side, level in ((1, -1), (1, 1), (-1, -1), (-1, 1)):
            first = x + beside if side > 0 else x - beside - wide
            top = y - beside - high if level < 0 else y + beside
            box = _Box(first, top, first + wide, top + high)
            own = _Box(x - away, y - away, x + away, y + away)
            others = [other for other in taken if other != own]
            if frame.holds(box) and not any(box.meets(other) for other in others):
                break
        else:
            continue
        taken.append(box)
        axes.text(
            box.left,
            (box.top + box.bottom) / 2,
            text,
            color=style.SKY,
            fontsize=style.SMALL,
            va="center",
            path_effects=[style.outline("black")],
        )


class _Box(NamedTuple):
    """A rectangle of a frame, pixel."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: _Box) -> bool:
        """Whether two boxes overlap."""
        apart = self.right <= other.left or other.right <= self.left
        return not (apart or self.bottom <= other.top or other.bottom <= self.top)

    def holds(self, other: _Box) -> bool:
        """Whether another box lies inside."""
        across = self.left <= other.left and other.right <= self.right
        return across and self.top <= other.top and other.bottom <= self.bottom


def _compass(axes: Axes, camera: Camera, icrs_to_camera: Rotation) -> None:
    """Arrows to celestial north and east from a corner, and a bar of a round angle."""
    z = icrs_to_camera.inv().apply([0.0, 0.0, 1.0])
    east = np.cross([0.0, 0.0, 1.0], z)
    east = east / np.linalg.norm(east) if np.linalg.norm(east) > 1e-12 else np.array([0.0, 1.0, 0])
    length = 0.07 * min(camera.rows, camera.columns)
    origin = np.array([1.8 * length, camera.rows - 2.6 * length])
    small = 1 / camera.focal_length_px
    middle = camera.project(icrs_to_camera.apply(z[None]))[0]
    for tangent, letter in ((np.cross(z, east), "N"), (east, "E")):
        moved = camera.project(icrs_to_camera.apply((z + small * tangent)[None]))[0] - middle
        step = length * moved / np.hypot(*moved)
        for width, colour in ((3.0, "black"), (1.4, style.YELLOW)):
            axes.annotate(
                "",
                tuple(origin + step),
                tuple(origin),
                arrowprops={"arrowstyle": "->", "color": colour, "lw": width, "shrinkA": 0},
            )
        x, y = (origin + 1.4 * step).tolist()
        axes.text(
            x,
            y,
            letter,
            color=style.YELLOW,
            fontsize=9,
            ha="center",
            va="center",
            path_effects=[style.outline("black")],
        )
    _scale_bar(axes, camera)


def _scale_bar(axes: Axes, camera: Camera) -> None:
    """The largest round angle that spans a fifth of the columns or less."""
    pixel = 1 / camera.focal_length_px / arcsec
    fits = [size for size in SCALES if size / pixel < 0.2 * camera.columns]
    if not fits:
        return
    size = fits[-1]
    end = 0.97 * camera.columns
    x, y = (end - size / pixel, end), 0.965 * camera.rows
    for width, colour in ((4.5, "black"), (2.0, style.YELLOW)):
        axes.plot(
            x, (y, y), color=colour, lw=width, solid_capstyle="butt", scalex=False, scaley=False
        )
    text = (
        f"{size * arcsec / deg:g}°"
        if size >= 3600
        else (f"{size / 60:g}'" if size >= 60 else f"{size:g}''")
    )
    edge = [style.outline("black")]
    style.note(
        axes,
        text,
        (sum(x) / 2, y),
        (0, 4),
        color=style.YELLOW,
        ha="center",
        va="bottom",
        path_effects=edge,
    )


CELLS = 640  # along the longer side; a picture of 1280 pixels shows each with two
FEW_CELLS = 360  # up to which each is a pixel where the picture is 400 wide
BRIGHT = 5.0  # noise above the background; brighter cells are drawn wider
AROUND = 3.0  # noise of their mean, least excess of the pixels around a star
FOURTH = 4  # largest of a pixel and the eight around it
BESIDE = 1.0  # noise above the background, its least value in a star
TAIL = 2.33  # noise that 1 % of normal numbers exceed
RANGE = 4.0  # noise from black to white, at least
DARK = 1.5  # noise above the background up to which a pixel is black


class Stretch(NamedTuple):
    """A frame as it is drawn.

    image      (m, n) digital number, largest of each block of pixels
    block      pixel, side of a block
    wider      whether bright blocks are drawn three times as wide, so that they are seen
    black      digital number that is drawn black, with all below
    noise      digital number rms of the background
    white      digital number that is drawn white, with all above
    saturation  least digital number of a saturated pixel; infinite where unknown
    saturated  number of saturated pixels of the frame
    """

    image: Floats
    block: int
    wider: bool
    black: float
    noise: float
    white: float
    saturation: float
    saturated: int

    def level(self, number: Floats) -> Floats:
        """Brightness in [0, 1] of digital numbers.

            cbrt(ln(1 + s) / ln(1 + s_white)),   s = (number - black) / noise

        Faint stars are far from black, whatever the brightest one is. For s < 0 the sign is
        reversed.
        """
        signal = (np.asarray(number, float) - self.black) / self.noise
        return np.asarray(np.sign(signal) * np.cbrt(np.log1p(np.abs(signal)) / self._top))

    def number(self, level: Floats) -> Floats:
        """Inverse of `level`."""
        signal = np.sign(level) * np.expm1(np.abs(level) ** 3 * self._top)
        return np.asarray(self.black + self.noise * signal)

    @property
    def norm(self) -> FuncNorm:
        """The stretch for a colour map."""
        return FuncNorm((self.level, self.number), vmin=self.black, vmax=self.white)

    @property
    def _top(self) -> float:
        return math.log1p((self.white - self.black) / self.noise)


def stretch(image: NDArray[np.number], saturation: float | None = None) -> Stretch:
    """Fit the brightness to the background and the noise of a frame.

    image       (rows, columns) digital number; pixels that are not finite are black
    saturation  digital number from which on pixels are saturated; None: the largest of the type
                of an image of integers
    """
    values = np.asarray(image, float)
    if saturation is None and np.issubdtype(image.dtype, np.integer):
        largest = float(np.iinfo(image.dtype.name).max)
        saturation = largest
    limit = math.inf if saturation is None else saturation
    saturated = int((values >= limit).sum())
    block = max(1, math.ceil(max(values.shape) / CELLS))
    reduced = _largest(np.where(np.isfinite(values), values, -np.inf), block)
    finite = reduced[np.isfinite(reduced)]
    if not len(finite):
        return Stretch(
            reduced,
            block,
            wider=False,
            black=0.0,
            noise=1.0,
            white=1.0,
            saturation=limit,
            saturated=saturated,
        )
    ground = median, noise = _ground(finite)
    black = median + DARK * noise
    if saturated:
        black = min(black, limit - RANGE * noise)
    white = max(min(float(finite.max()), limit), black + RANGE * noise)
    wider = max(reduced.shape) > FEW_CELLS
    if wider:
        bright = values > median + BRIGHT * noise
        if block < 3:
            # A star shines into the eight pixels around; a hot pixel does not, and stays small.
            single = block == 1
            middle, of_pixels = ground if single else _ground(values[np.isfinite(values)])
            filled = np.where(np.isfinite(values), values, middle)
            around = (9 * uniform_filter(filled, 3) - filled) / 8
            bright &= around > middle + AROUND * of_pixels / math.sqrt(8)
            # Two hot pixels beside each other are no star either: it shines into three at least.
            bright[bright] = _fourth(filled, bright) > middle + BESIDE * of_pixels
        wide = _largest(np.where(bright, values, -np.inf), block)
        reduced = np.maximum(
            reduced, cv2.dilate(wide, np.ones((3, 3)), borderType=cv2.BORDER_REPLICATE)
        )
    return Stretch(
        image=reduced,
        block=block,
        wider=wider,
        black=black,
        noise=noise,
        white=white,
        saturation=limit,
        saturated=saturated,
    )


def _ground(values: Floats) -> tuple[float, float]:
    """The median of finite values, and their noise; of a constant frame, one digital number."""
    median, above, tail = np.percentile(values, [50, 84, 99])
    # Where the noise is less than a digital number, or of hot pixels, its tail counts.
    noise = max(above - median, (tail - median) / TAIL, 1e-3 * (values.max() - median))
    return float(median), float(noise) or 1.0


def _fourth(image: Floats, chosen: Flags) -> Floats:
    """The fourth largest of each chosen pixel and the eight around it."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(image, 1, "symmetric"), (3, 3))
    return np.asarray(np.partition(around[chosen].reshape(-1, 9), -FOURTH)[:, -FOURTH])


def _largest(image: Floats, block: int) -> Floats:
    """The largest of each block of pixels, so that no star is lost between two."""
    if block == 1:
        return image
    rows, columns = (-(-n // block) * block for n in image.shape)
    brightest = np.full((rows, columns), -np.inf)
    brightest[: image.shape[0], : image.shape[1]] = image
    parts = brightest.reshape(rows // block, block, columns // block, block)
    return np.asarray(parts.max(axis=(1, 3)))
