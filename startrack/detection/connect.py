"""A filtered image and its threshold enter; local maxima leave, several where stars touch."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Ints, Singles, kernel
from startrack.detection.background import SkyBackground, between


class Peaks(NamedTuple):
    """Places of possible stars: (n,) column, row, and size of the connected component, pixel."""

    x: Ints
    y: Ints
    area: Ints


@kernel
def lit(image: Singles, level: Singles, mesh: int) -> Ints:
    """Pixels that exceed a level that is given on the grid of a Sky.

    A row (then its part in a tile) below the lowest level around it needs only one comparison for
    each pixel; nearly all rows are such.

    Returns  (n,) row * columns + column, row by row
    """
    rows, columns = image.shape
    bright = []
    lowest = np.empty(level.shape[1] - 2, np.float32)
    for i in range(level.shape[0] - 2):
        for j in range(len(lowest)):
            lowest[j] = level[i : i + 3, j : j + 3].min()
        lowest_of_row = lowest.min()
        for y in range(i * mesh, min((i + 1) * mesh, rows)):
            if not any_above(image[y], lowest_of_row):
                continue
            for j in range(len(lowest)):
                left, right = j * mesh, min((j + 1) * mesh, columns)
                if not any_above(image[y, left:right], lowest[j]):
                    continue
                for x in range(left, right):
                    if image[y, x] > lowest[j] and image[y, x] > between(level, mesh, x, y):
                        bright.append(y * columns + x)
    return np.array(bright, np.int64)


@kernel
def any_above(values: Singles, level: float) -> bool:
    """Whether any value exceeds the level; without a branch, so that the loop is vectorised."""
    above = False
    for k in range(len(values)):
        above |= values[k] > level
    return above


@kernel
def peaks(
    image: Singles,
    pixels: Ints,
    waiting: NDArray[np.uint8],
    min_area: int,
    max_area: int,
    half: int,
    border: int,
) -> Peaks:
    """Local maxima of the components whose size is right; several where stars touch.

    pixels   (n,) lit pixels, as from `lit`; touching pixels, corners included, are a component
    waiting  (rows, columns) work array of zeros, which is all zeros again at the end
    half     pixel, half side of the square in which a peak must be the highest
    border   pixel, distance that a peak must keep from the border
    """
    rows, columns = image.shape
    lit_x, lit_y = np.empty((2, len(pixels)), np.int64)
    for k in range(len(pixels)):
        lit_y[k] = pixels[k] // columns
        lit_x[k] = pixels[k] - lit_y[k] * columns
        waiting[lit_y[k], lit_x[k]] = 1
    x, y, area = np.empty((3, len(pixels)), np.int64)
    member_x, member_y = np.empty((2, len(pixels)), np.int64)
    count = 0
    for k in range(len(pixels)):
        size = _component(waiting, lit_x[k], lit_y[k], member_x, member_y)
        if size < max(min_area, 1) or size > max_area:
            continue
        for n in range(size):
            u, v = member_x[n], member_y[n]
            inside = border <= u < columns - border and border <= v < rows - border
            if inside and highest(image, u, v, half):
                x[count], y[count], area[count] = u, v, size
                count += 1
    return Peaks(x[:count], y[:count], area[:count])


@kernel
def _component(waiting: NDArray[np.uint8], x: int, y: int, member_x: Ints, member_y: Ints) -> int:
    """Collect the waiting pixels that are connected to a pixel; 0 if this pixel is no longer
    waiting."""
    rows, columns = waiting.shape
    if not waiting[y, x]:
        return 0
    waiting[y, x] = 0
    member_x[0], member_y[0] = x, y
    size, done = 1, 0
    while done < size:
        x, y = member_x[done], member_y[done]
        done += 1
        for v in range(max(y - 1, 0), min(y + 2, rows)):
            for u in range(max(x - 1, 0), min(x + 2, columns)):
                if waiting[v, u]:
                    waiting[v, u] = 0
                    member_x[size], member_y[size] = u, v
                    size += 1
    return size


@kernel
def highest(image: Singles, x: int, y: int, half: int) -> bool:
    """Whether no pixel around is higher; among equal pixels the first is the highest."""
    here = image[y, x]
    rows, columns = image.shape
    for v in range(max(y - half, 0), min(y + half + 1, rows)):
        for u in range(max(x - half, 0), min(x + half + 1, columns)):
            earlier = v < y or (v == y and u < x)
            if image[v, u] > here or (earlier and image[v, u] == here):
                return False
    return True


CERTAIN = 4.0  # sigma; noise splits a bright star into maxima; one in 10 000 dips this far
BRIGHT = 20.0  # sigma of a pixel; fainter stars are separated by the filter alone
REACH = 4  # pixel; a filter of a usual star merges no peaks that are farther apart
MOST = 4  # stars for one peak


@kernel
def split(
    image: Singles, merged: Peaks, sky: SkyBackground, noise: float, shot: float, border: int
) -> Peaks:
    """Split the peaks that the filter has merged.

    Two maxima of the image itself are two stars if the image between them dips by more than noise.

    noise      fraction of a pixel's noise that the filter leaves
    shot       digital number, variance for each digital number of light; NaN where unknown
    border     pixel, distance that a peak must keep from the border, at least 1
    """
    size = len(merged.x)
    x, y, area = np.empty((3, MOST * size), np.int64)
    count = 0
    near_x, near_y = np.empty((2, MOST), np.int64)
    for i in range(size):
        u, v = merged.x[i], merged.y[i]
        level = between(sky.mean, sky.mesh, u, v)
        sigma = between(sky.rms, sky.mesh, u, v) / noise
        light = sigma**2 / max(level, sigma) if math.isnan(shot) else shot
        stars = _maxima(image, u, v, level, sigma, light, border, near_x, near_y)
        if stars < 2:
            near_x[0], near_y[0], stars = u, v, 1
        for k in range(stars):
            if not ((x[:count] == near_x[k]) & (y[:count] == near_y[k])).any():
                x[count], y[count], area[count] = near_x[k], near_y[k], merged.area[i]
                count += 1
    return Peaks(x[:count], y[:count], area[:count])


@kernel
def _maxima(
    image: Singles,
    x: int,
    y: int,
    level: float,
    sigma: float,
    shot: float,
    border: int,
    near_x: Ints,
    near_y: Ints,
) -> int:
    """Write the brightest maxima around a pixel with dips between them; return their number."""
    rows, columns = image.shape
    count = 0
    if image[y, x] - level < BRIGHT * sigma:
        return 0
    while count < MOST:
        best, at_x, at_y = BRIGHT * sigma, -1, -1
        for v in range(max(y - REACH, border), min(y + REACH + 1, rows - border)):
            for u in range(max(x - REACH, border), min(x + REACH + 1, columns - border)):
                high = image[v, u] - level
                if high > best and highest(image, u, v, 1):
                    error = math.sqrt(2 * (sigma**2 + shot * high))
                    if _dips(image, u, v, near_x[:count], near_y[:count], CERTAIN * error):
                        best, at_x, at_y = high, u, v
        if at_x < 0:
            break
        near_x[count], near_y[count] = at_x, at_y
        count += 1
    return count


@kernel
def _dips(image, x, y, others_x, others_y, depth):  # type: ignore[no-untyped-def]
    """Whether the image dips by some depth between a maximum and each of the others."""
    for k in range(len(others_x)):
        far_x, far_y = others_x[k] - x, others_y[k] - y
        steps = max(abs(far_x), abs(far_y))
        lowest = float(image[y, x])
        for s in range(1, steps):
            u, v = x + round(far_x * s / steps), y + round(far_y * s / steps)
            lowest = min(lowest, image[v, u])
        if not image[y, x] - lowest > depth:
            return False
    return True
