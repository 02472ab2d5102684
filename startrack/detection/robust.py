"""Pixels -> their background, its slopes and its noise, robust against stars among them."""

import math

import numpy as np

from startrack.core import Floats, Ints, Singles, instead_of, kernel, median

CLIP = 3.0  # sigma
ROUNDS = 6
SAMPLE = 27  # pixels of the first guess: 3^3
DEVIATION_TO_SIGMA = 1.2533  # mean absolute deviation of a normal law: sqrt(pi / 2)
# A normal law that is clipped at 3 sigma repeatedly converges to 0.984 of its sigma.
CLIPPED_TO_SIGMA = 1.016
SLOPES = 4  # iterations for a plane
# Fraction of the variance; a plane that explains less may be chance, because a ring of correlated
# noise holds only about twenty independent values.
LEAST_FRACTION = 0.3
NOBODY = np.empty(0, np.int64)
MOST_LEFT_OUT = 0.85  # of a ring; with more spots in it, their light is part of the background


# Sums may be taken in any order, so that the processor can add several pixels at once.
@kernel(fastmath={"reassoc", "nsz", "contract"})
def clipped(values: Singles, floor: float) -> tuple[float, float]:
    """Mean and standard deviation of the values that lie within 3 sigma of the mean.

    The first guess is a median and the mean deviation from it. It works if stars or hot pixels take
    less than a quarter of the values; if trees or a limb take more, the noise is as large as they
    are. The mean resolves fractions of a digital number; the median of an 8-bit image does not.

    values   (n,) in any unit, n > 0
    floor    least standard deviation, in the same unit
    Returns  mean, standard deviation
    """
    sample = values[:: max(1, len(values) // SAMPLE)]
    mean = np.float32(_median(sample))
    deviation = np.float32(0)
    for i in range(len(sample)):
        deviation += abs(sample[i] - mean)
    rms = max(DEVIATION_TO_SIGMA * float(deviation) / len(sample), floor)
    count = np.float32(0)
    for _ in range(ROUNDS):
        # Offsets from the last mean are small, so float32 sums lose no digits.
        limit = np.float32(CLIP * rms)
        # All in float32, or the processor could not add several pixels at once.
        kept, first, second = np.float32(0), np.float32(0), np.float32(0)
        for i in range(len(values)):
            offset = values[i] - mean
            inside = np.float32(abs(offset) <= limit)
            offset *= inside
            kept += inside
            first += offset
            second += offset * offset
        if kept == 0:
            break
        shift = first / kept
        mean += np.float32(shift)
        variance = float(second / kept - shift * shift)
        rms = max(CLIPPED_TO_SIGMA * math.sqrt(max(variance, 0.0)), floor)
        if kept == count:
            break
        count = kept
    return float(mean), rms


@instead_of(clipped)
def _clipped_of_arrays(values: Singles, floor: float) -> tuple[float, float]:
    sample = values[:: max(1, len(values) // SAMPLE)]
    mean = np.float32(_median(sample))
    deviation = float(np.abs(sample - mean).sum())
    rms = max(DEVIATION_TO_SIGMA * deviation / len(sample), floor)
    count = np.float32(0)
    for _ in range(ROUNDS):
        offset = values - mean
        inside = np.abs(offset) <= np.float32(CLIP * rms)
        offset *= inside
        kept = np.float32(np.count_nonzero(inside))
        if kept == 0:
            break
        shift = offset.sum() / kept
        mean += np.float32(shift)
        variance = float((offset * offset).sum() / kept - shift * shift)
        rms = max(CLIPPED_TO_SIGMA * math.sqrt(max(variance, 0.0)), floor)
        if kept == count:
            break
        count = kept
    return float(mean), rms


@kernel
def _median(values: Singles) -> float:
    """A median; of 27 values and more the median of medians of medians of three.

    Source: Rousseeuw and Bassett (1990), the remedian. It has no branches that random numbers make
    unpredictable, and takes a tenth of the time of a true median.
    """
    if len(values) < SAMPLE:
        copied = np.empty(len(values))
        for i in range(len(values)):
            copied[i] = values[i]
        return median(copied)
    return float(_middle(_of_nine(values, 0), _of_nine(values, 1), _of_nine(values, 2)))


@kernel(inline="always")
def _of_nine(values, i):  # type: ignore[no-untyped-def]
    first = _middle(values[i], values[i + 9], values[i + 18])
    second = _middle(values[i + 3], values[i + 12], values[i + 21])
    return _middle(first, second, _middle(values[i + 6], values[i + 15], values[i + 24]))


@kernel(inline="always")
def _middle(a, b, c):  # type: ignore[no-untyped-def]
    return max(min(a, b), min(max(a, b), c))


@kernel
def plane(
    values: Singles, dx: Singles, dy: Singles, floor: float
) -> tuple[float, float, float, float]:
    """Level, slopes and noise of pixels on a gradient; `values` lose the slopes in place.

    A slope is removed only if noise alone is unlikely to cause it, so that a uniform background is
    not made uneven.

    values   (n,) in any unit; dx, dy (n,) pixel, their places
    floor    least noise, in the unit of the values
    Returns  value at (0, 0), slopes along x and y per pixel, standard deviation about the plane
    """
    slope_x, slope_y = 0.0, 0.0
    mean, rms = clipped(values, floor)
    for _ in range(SLOPES):
        gx, gy, fraction = _slopes(values, dx, dy, mean, rms)
        if not fraction > LEAST_FRACTION:
            break
        x, y = np.float32(gx), np.float32(gy)
        for i in range(len(values)):
            values[i] -= x * dx[i] + y * dy[i]
        slope_x, slope_y = slope_x + gx, slope_y + gy
        mean, rms = clipped(values, floor)
    return mean, slope_x, slope_y, rms


@kernel(fastmath={"reassoc", "nsz", "contract"})
def _slopes(
    values: Singles, dx: Singles, dy: Singles, mean: float, rms: float
) -> tuple[float, float, float]:
    """Least-squares slopes of the values within 3 sigma, and the fraction of variance they
    explain."""
    limit, level = np.float32(CLIP * rms), np.float32(mean)
    zero = np.float32(0)
    x, y, xx, yy, count = zero, zero, zero, zero, zero
    for i in range(len(values)):
        offset = values[i] - level
        inside = np.float32(abs(offset) <= limit)
        offset *= inside
        count += inside
        x += offset * dx[i]
        y += offset * dy[i]
        xx += inside * dx[i] * dx[i]
        yy += inside * dy[i] * dy[i]
    gx = x / xx if xx > 0 else zero
    gy = y / yy if yy > 0 else zero
    if count == 0 or rms == 0:
        return 0.0, 0.0, 0.0
    return float(gx), float(gy), float((gx * gx * xx + gy * gy * yy) / (count * rms**2))


@instead_of(_slopes)
def _slopes_of_arrays(
    values: Singles, dx: Singles, dy: Singles, mean: float, rms: float
) -> tuple[float, float, float]:
    offset = values - np.float32(mean)
    inside = np.abs(offset) <= np.float32(CLIP * rms)
    offset *= inside
    count, zero = np.count_nonzero(inside), np.float32(0)
    xx, yy = (dx * dx * inside).sum(), (dy * dy * inside).sum()
    gx = (offset * dx).sum() / xx if xx > 0 else zero
    gy = (offset * dy).sum() / yy if yy > 0 else zero
    if count == 0 or rms == 0:
        return 0.0, 0.0, 0.0
    return float(gx), float(gy), float((gx * gx * xx + gy * gy * yy) / (count * rms**2))


@kernel
def around(
    image: Singles, x: int, y: int, half: int, floor: float
) -> tuple[float, float, float, float, int]:
    """Background around a spot, from the square ring around a window of some half side.

    The ring is two pixels wide and one pixel from the window, cut at the border of the image.

    Returns  as `plane`, about (x, y), and the number of pixels of the ring
    """
    return around_among(image, x, y, half, floor, NOBODY, NOBODY)


@kernel
def around_each(image: Singles, x: Ints, y: Ints, half: int, floor: float) -> Floats:
    """`around` for many spots at pixels (n,): level, slopes and noise, (n, 4)."""
    grounds = np.empty((len(x), 4))
    for i in range(len(x)):
        level, slope_x, slope_y, noise, _ = around(image, x[i], y[i], half, floor)
        grounds[i, 0], grounds[i, 1], grounds[i, 2], grounds[i, 3] = level, slope_x, slope_y, noise
    return grounds


@kernel
def around_among(
    image: Singles, x: int, y: int, half: int, floor: float, others_x: Ints, others_y: Ints
) -> tuple[float, float, float, float, int]:
    """`around` without the squares around other spots, if enough of the ring is left."""
    rows, columns = image.shape
    inner, outer = half + 2, half + 3
    most = (2 * outer + 1) ** 2 - (2 * inner - 1) ** 2
    values, dx, dy = np.empty((3, most), np.float32)
    # Values that are left out are stored from the end, in case they are needed.
    count, left_out = 0, 0
    for row in range(max(0, y - outer), min(rows, y + outer + 1)):
        for column in range(max(0, x - outer), min(columns, x + outer + 1)):
            if abs(row - y) >= inner or abs(column - x) >= inner:
                if _near_one(column, row, others_x, others_y, half + 1):
                    left_out += 1
                    place = most - left_out
                else:
                    place = count
                    count += 1
                values[place] = image[row, column]
                dx[place], dy[place] = column - x, row - y
    if left_out > MOST_LEFT_OUT * (count + left_out):
        for k in range(most - left_out, most):
            values[count], dx[count], dy[count] = values[k], dx[k], dy[k]
            count += 1
    if count == 0:
        return float(image[y, x]), 0.0, 0.0, floor, 1
    mean, slope_x, slope_y, rms = plane(values[:count], dx[:count], dy[:count], floor)
    return mean, slope_x, slope_y, rms, count


@instead_of(around_among)
def _around_among_of_arrays(
    image: Singles, x: int, y: int, half: int, floor: float, others_x: Ints, others_y: Ints
) -> tuple[float, float, float, float, int]:
    rows, columns = image.shape
    inner, outer = half + 2, half + 3
    row, column = np.mgrid[
        max(0, y - outer) : min(rows, y + outer + 1),
        max(0, x - outer) : min(columns, x + outer + 1),
    ]
    ring = (np.abs(row - y) >= inner) | (np.abs(column - x) >= inner)
    row, column = row[ring], column[ring]
    far_x, far_y = np.abs(others_x[:, None] - column), np.abs(others_y[:, None] - row)
    near = ((far_x <= half + 1) & (far_y <= half + 1)).any(axis=0)
    some = np.flatnonzero(~near)
    if np.count_nonzero(near) > MOST_LEFT_OUT * len(row):
        some = np.append(some, np.flatnonzero(near)[::-1])
    if len(some) == 0:
        return float(image[y, x]), 0.0, 0.0, floor, 1
    row, column = row[some], column[some]
    dx, dy = (column - x).astype(np.float32), (row - y).astype(np.float32)
    mean, slope_x, slope_y, rms = plane(image[row, column], dx, dy, floor)
    return mean, slope_x, slope_y, rms, len(some)


@kernel
def _near_one(x: int, y: int, others_x: Ints, others_y: Ints, far: int) -> bool:
    for k in range(len(others_x)):
        if abs(others_x[k] - x) <= far and abs(others_y[k] - y) <= far:
            return True
    return False
