"""Frame -> brightness of a picture in which faint stars are seen, at any size."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from matplotlib.colors import FuncNorm
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from startrack.core import Floats

CELLS = 640  # along the longer side; a picture of 1280 pixels shows each with two
FEW_CELLS = 360  # up to which each is a pixel where the picture is 400 wide
BRIGHT = 5.0  # noise above the background, from which on a cell is drawn wider
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
    saturation  digital number from which on pixels are saturated; infinite where unknown
    saturated  number of pixels of the frame that are
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

        Faint stars are far from black, whatever the brightest one is; the opposite for s < 0.
        """
        signal = (np.asarray(number, float) - self.black) / self.noise
        return np.asarray(np.sign(signal) * np.cbrt(np.log1p(np.abs(signal)) / self._top))

    def number(self, level: Floats) -> Floats:
        """Inverse of `level`."""
        signal = np.sign(level) * np.expm1(np.abs(level) ** 3 * self._top)
        return np.asarray(self.black + self.noise * signal)

    @property
    def norm(self) -> FuncNorm:
        """The same for a map of colours."""
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
    known = reduced[np.isfinite(reduced)]
    if not len(known):
        return Stretch(reduced, block, False, 0.0, 1.0, 1.0, limit, saturated)
    median, above = np.percentile(known, [50, 84])
    largest = float(known.max())
    # Of a constant frame, one digital number.
    noise = max(float(above - median), 1e-3 * (largest - float(median))) or 1.0
    black = float(median) + DARK * noise
    if saturated:
        black = min(black, limit - RANGE * noise)
    white = max(min(largest, limit), black + RANGE * noise)
    wider = max(reduced.shape) > FEW_CELLS
    if wider:
        bright = np.where(reduced > median + BRIGHT * noise, reduced, -np.inf)
        reduced = np.maximum(reduced, maximum_filter(bright, 3, mode="nearest"))
    return Stretch(reduced, block, wider, black, noise, white, limit, saturated)


def _largest(image: Floats, block: int) -> Floats:
    """The largest of each block of pixels, so that no star is lost between two."""
    if block == 1:
        return image
    rows, columns = (-(-n // block) * block for n in image.shape)
    whole = np.full((rows, columns), -np.inf)
    whole[: image.shape[0], : image.shape[1]] = image
    parts = whole.reshape(rows // block, block, columns // block, block)
    return np.asarray(parts.max(axis=(1, 3)))
