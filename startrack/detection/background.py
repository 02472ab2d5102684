"""Filtered image -> Sky: its background and noise, tile by tile."""

from typing import NamedTuple

import cv2
import numpy as np

from startrack.core import Singles, bilinear, kernel
from startrack.detection.matched import KURTOSIS_RATIO, MILD_SKEWNESS, Kernel, noise_from_gain
from startrack.detection.pixels import PixelGain
from startrack.detection.robust import plane

MOST_SKEWNESS = 1.5
STRIDE = 4  # pixel; the filtered image is smooth, so few rows and columns suffice
TAIL = 5.0  # sigma; values farther out are stars, not the tail of the noise
# One tile gives its noise within 9 %. At 5 sigma, a level 9 % too low passes ten times more noise,
# and a level 9 % too high loses a sixth of the faintest stars. So similar tiles share their noise.
CHANCE = 1.3
ALIKE = 0.5  # sigma; the mean of one tile is known to 0.12, of nine tiles to 0.05
SKEWED = 0.4  # 25 tiles show this by chance once in a million
# Statistics of a tile of 64 values from a gamma law of skewness g, whose tail is clipped like
# stars: (1 - 0.007 - 0.03 g - 0.06 g^2) of its rms, 0.86 of g, its mean 0.05 g sigma low.
SHOWN_SKEWNESS = 0.86
MORE_THAN_MODEL = 1.08  # of the model's noise; 25 tiles show that by chance once in 1000


class SkyBackground(NamedTuple):
    """Background and noise of an image, at the centres of its tiles and of one more tile around.

    mean      (down + 2, across + 2) digital number
    rms       (down + 2, across + 2) digital number
    skewness  (down + 2, across + 2) 1, of the noise
    kurtosis  (down + 2, across + 2) 1, its excess
    mesh      pixel, side of a tile
    """

    mean: Singles
    rms: Singles
    skewness: Singles
    kurtosis: Singles
    mesh: int


def sky(filtered: Singles, mesh: int, floor: float, stride: int = STRIDE) -> SkyBackground:
    """Measure the background and the noise of an image that was filtered.

    A plane and the noise about it are measured on the filtered image itself, in tiles. So haze, a
    limb or correlated noise raises the level only locally, and a gradient does not raise it.

    filtered  (rows, columns) digital number
    mesh      pixel, side of a tile
    floor     digital number, least noise
    stride    pixel, between the rows and between the columns that are read
    Accuracy  statistical, for 32-pixel tiles: 0.05 sigma of the filtered image in the mean and 2 %
              in the noise if neighbours are similar, else 0.12 sigma and 9 %.
    """
    mesh = min(mesh, max(filtered.shape))
    mean, rms, skewness = _tiles(filtered, mesh, floor, stride)
    side = 5 if min(rms.shape) >= 5 else 3
    around = cv2.medianBlur(rms, side)
    rms = np.where(rms > CHANCE * around, rms, around)
    noise = _wider(rms)
    shared = cv2.blur(mean, (3, 3), borderType=cv2.BORDER_REPLICATE)
    mean = np.where(np.abs(mean - shared) < ALIKE * noise, shared, mean)
    # One tile is too small to measure skewness; many tiles suffice. Leaves have more than the sky.
    around = cv2.medianBlur(skewness, side)
    skewness = np.where(around > SKEWED, around, np.median(skewness) / SHOWN_SKEWNESS)
    skewness = _wider(np.clip(skewness, 0, MOST_SKEWNESS))
    mild = np.minimum(skewness, np.float32(MILD_SKEWNESS))
    mean = mean + np.float32(0.05) * mild * noise
    noise = noise * (np.float32(1.007) + mild * (np.float32(0.03) + np.float32(0.06) * mild))
    return SkyBackground(mean, noise, skewness, np.float32(KURTOSIS_RATIO) * skewness**2, mesh)


def with_gain_noise(
    ground: SkyBackground, gain: PixelGain, step: float, filter: Kernel
) -> SkyBackground:
    """The background with the noise of the gain model, unless the tiles show more noise.

    step  digital number between two neighbouring values
    """
    model = noise_from_gain(ground.mean, gain, step, filter)
    kept = ground.rms <= MORE_THAN_MODEL * model[0]
    rms, skewness, kurtosis = (
        np.where(kept, by_gain, seen) for by_gain, seen in zip(model, ground[1:4], strict=True)
    )
    return SkyBackground(ground.mean, rms, skewness, kurtosis, ground.mesh)


def _wider(grid: Singles) -> Singles:
    """One more tile on each side, equal to its neighbour."""
    border = cv2.copyMakeBorder(grid.astype(np.float32), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    return np.asarray(border, np.float32)


@kernel
def between(grid: Singles, mesh: int, x: float, y: float) -> float:
    """Bilinear interpolation of a Sky's grid at a pixel."""
    return bilinear(grid, (y + 0.5) / mesh + 0.5, (x + 0.5) / mesh + 0.5)


@kernel
def _tiles(
    image: Singles, mesh: int, floor: float, stride: int
) -> tuple[Singles, Singles, Singles]:
    """Background, noise and skewness of square tiles.

    Returns  background at the centres of the tiles and of one more tile on each side, by the
             outer tiles' slopes; noise and skewness of the tiles alone
    """
    rows, columns = image.shape
    down, across = -(-rows // mesh), -(-columns // mesh)
    mean = np.empty((down + 2, across + 2), np.float32)
    rms = np.empty((down, across), np.float32)
    skewness = np.empty((down, across), np.float32)
    width, height = min(mesh, columns), min(mesh, rows)
    dx, dy = _places(width, height, stride)
    values = np.empty(len(dx), np.float32)
    for i in range(down):
        # The last tile is moved inwards to be whole; its plane is extrapolated.
        top = max(min(i * mesh, rows - mesh), 0)
        for j in range(across):
            left = max(min(j * mesh, columns - mesh), 0)
            _gather(image[top : top + mesh, left : left + mesh], values, stride)
            level, slope_x, slope_y, rms[i, j] = plane(values, dx, dy, floor)
            skewness[i, j] = _skewness(values, level, rms[i, j])
            level += slope_x * (j * mesh - left + (mesh - width) / 2)
            level += slope_y * (i * mesh - top + (mesh - height) / 2)
            # An outer tile also represents its neighbour beyond the border.
            for v in range(i if i == 0 else i + 1, i + 3 if i == down - 1 else i + 2):
                for u in range(j if j == 0 else j + 1, j + 3 if j == across - 1 else j + 2):
                    steps = slope_x * (u - 1 - j) + slope_y * (v - 1 - i)
                    mean[v, u] = level + mesh * steps
    return mean, rms, skewness


@kernel
def _places(width: int, height: int, stride: int) -> tuple[Singles, Singles]:
    """Places of the pixels that are read, from the middle of a tile, (n,) pixel."""
    across, down = np.arange(0, width, stride), np.arange(0, height, stride)
    dx = np.empty(len(across) * len(down), np.float32)
    dy = np.empty(len(across) * len(down), np.float32)
    for i in range(len(down)):
        for j in range(len(across)):
            dx[i * len(across) + j] = across[j] - (width - 1) / 2
            dy[i * len(across) + j] = down[i] - (height - 1) / 2
    return dx, dy


@kernel
def _gather(tile: Singles, values: Singles, stride: int) -> None:
    """Copy the pixels of a tile that are read."""
    rows, columns = tile.shape
    count = 0
    for y in range(0, rows, stride):
        for x in range(0, columns, stride):
            values[count] = tile[y, x]
            count += 1


@kernel(fastmath={"reassoc", "nsz", "contract"})
def _skewness(values: Singles, mean: float, rms: float) -> float:
    """Third standardised moment of the values that are noise; 0 without such values."""
    if rms == 0:
        return 0.0
    total, count = np.float32(0), np.float32(0)
    level, scale = np.float32(mean), np.float32(1 / rms)
    for i in range(len(values)):
        z = (values[i] - level) * scale
        inside = np.float32(abs(z) <= np.float32(TAIL))
        total += inside * z * z * z
        count += inside
    return float(total / max(count, np.float32(1)))
