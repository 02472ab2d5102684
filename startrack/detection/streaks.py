"""Pixels -> the smear that all stars of a frame share, from the streaks themselves."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from scipy import fft, special

from startrack.core import Floats, Frame, Spots
from startrack.detection.parameters import LONGEST_STREAK
from startrack.detection.plan import DetectionPlan, calibrated

# Chosen by hand, on rendered frames at rest to 3 deg/s.
BRIGHTEST = 100.0  # of a pixel's noise, upper limit of pixels: one star must not dominate
SHARP = 4.0  # times its brightest neighbour, upper limit of a pixel
AROUND = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], bool)
QUANTUM = 1 / math.sqrt(12)  # digital number, noise of rounding
STRIP = 8  # pixel at the frame's border that are left out, for dark columns
TIP = 1.5  # pixel between the ends of two streaks that are tried
POINTS = 1.0  # pixel between points along a streak
STACKED, FEWEST = 24, 3  # spots, most and fewest, whose mean image is fitted
FAR, APART = 1.0, 0.5  # largest difference from a first guess: pixel, fraction of its length
NEAR = 4.0  # sigma around the line: lags that are fitted
# Least height of a streak in sigma of white noise, and largest error of its length. By hand,
# between frames of the shipped designs at 0.2 to 5 deg/s (above 100 sigma, errors below 1.5 pixel
# of 20) and frames of hot pixels alone (below 20 sigma).
FIRM, SURE = 25.0, 0.06
LEAST = 1.0  # pixel; images of a lens may be as elongated as a shorter smear


class Streak(NamedTuple):
    """Motion of the sky in a frame.

    x, y    pixel, from one end of a streak to the other; its sign is unknown
    sigma   pixel, of each, from the residuals of the fit
    height  sigma, height of its ridge above noise
    """

    x: float
    y: float
    sigma: float
    height: float

    @property
    def seen(self) -> bool:
        """Whether a motion is visible: above noise, and longer than elongations of star images."""
        length = math.hypot(self.x, self.y)
        sure = self.sigma < SURE * length + 0.3
        return self.height > FIRM and sure and LEAST < length <= LONGEST_STREAK


def streak_of(frame: Frame, plan: DetectionPlan) -> Streak:
    """The smear that all stars of a frame share.

        A(d) = sum over pixels of I(p) I(p + d),   A of a streak s: a ridge from -s to s

    The autocorrelation of the frame adds the streaks of all stars, detected or not, in one place.
    White noise contributes only at d = 0. The result is the line whose tapered ridge is highest
    relative to the noise.

    plan      of the detection: its dark map, and the image of a star at rest
    Accuracy  model: one smear for the whole frame, without roll; brighter pixels are cut to
              BRIGHTEST. On frames of the shipped designs at 1 and 3 deg/s (4.4 and 13 pixel): 0.2
              to 0.4 pixel in the mean, 1 at worst.
    """
    value = np.asarray(calibrated(frame, plan).value, float)
    if min(value.shape) <= 2 * STRIP:
        return Streak(0.0, 0.0, math.inf, 0.0)
    value = np.where(np.isfinite(value), value, np.nanmedian(value))[STRIP:-STRIP, STRIP:-STRIP]
    # Rows and columns have different levels, which would make ridges.
    value = value - np.median(value, axis=0)
    value -= np.median(value, axis=1, keepdims=True)
    if not value.any():
        return Streak(0.0, 0.0, math.inf, 0.0)
    # Most pixels of a dark 8-bit image have the same number.
    noise = max(1.4826 * float(np.median(np.abs(value))), QUANTUM)
    value = np.clip(value / noise, -3.0, BRIGHTEST)
    # A pixel far above all of its neighbours is hot, not part of a star.
    value = np.minimum(value, SHARP * scipy.ndimage.maximum_filter(value, footprint=AROUND))
    value -= value.mean()
    far = math.ceil(LONGEST_STREAK * math.sqrt(2)) + 8
    ridge, spread = _autocorrelation(value, far), math.sqrt(value.size)
    ridge[far, far] = ridge[[far - 1, far + 1, far, far], [far, far, far - 1, far + 1]].mean()
    sigma = _width(plan)
    smooth = scipy.ndimage.gaussian_filter(ridge, sigma, mode="nearest")
    tried, place, weight, norm = _lines(far, sigma)
    along = scipy.ndimage.map_coordinates(smooth, place, order=1)
    height = np.add.reduceat(along * weight, tried[:, 2].astype(int)) / (norm * spread)
    best = tried[int(height.argmax()), :2]
    return _fitted(ridge / spread, best, sigma, float(height.max()))


def refined(frame: Frame, plan: DetectionPlan, spots: Spots, first: Streak) -> Streak:
    """A streak from the mean image of the brightest spots, which were found by a first guess.

    Accuracy  on frames of the shipped designs at 3 deg/s (13 pixel) 0.1 pixel in the mean.
    """
    half = math.ceil((math.hypot(first.x, first.y) + NEAR * _width(plan)) / 2) + 2
    value = np.asarray(calibrated(frame, plan).value, float)
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    images = []
    for k in range(min(len(spots), STACKED)):
        at = np.array([spots.y[k] + y, spots.x[k] + x])
        image = scipy.ndimage.map_coordinates(value, at, order=1, cval=np.nan)
        level = np.median(image[[0, -1]])
        if np.isfinite(image).all() and (total := float((image - level).sum())) > 0:
            images.append((image - level) / total)
    if len(images) < FEWEST:
        return first
    mean = np.median(images, axis=0)

    from scipy import optimize  # half of a second, for those who need it

    def off(unknown: Floats) -> Floats:
        sx, sy, width, light, level, left, top = unknown
        line = _blurred_line(x - left, y - top, sx, sy, width, 1)
        return np.asarray(light * line + level - mean).ravel()

    start = [first.x, first.y, _width(plan) / math.sqrt(2), 1.0, 0.0, 0.0, 0.0]
    fit = optimize.least_squares(off, start)
    sx, sy = float(fit.x[0]), float(fit.x[1])
    if math.hypot(sx - first.x, sy - first.y) > max(FAR, APART * math.hypot(first.x, first.y)):
        return first
    return first._replace(x=sx, y=sy)


def _fitted(ridge: Floats, start: Floats, sigma: float, height: float) -> Streak:
    """The triangular line, blurred by a Gaussian of free width, that fits the ridge best."""
    far = len(ridge) // 2
    limit = math.hypot(*start) + NEAR * sigma
    y, x = np.mgrid[0 : far + 1, -far : far + 1]  # each lag has its mirror
    unit = start / max(math.hypot(*start), 1e-9)
    beside = np.abs(unit[0] * y - unit[1] * x) < NEAR * sigma
    chosen = beside & (np.hypot(x, y) < limit) & ((y > 0) | (x > 0))
    x, y = x[chosen], y[chosen]
    value = ridge[far + y, far + x]

    from scipy import optimize  # half of a second, for those who need it

    def off(unknown: Floats) -> Floats:
        sx, sy, width, light = unknown
        return light * _blurred_line(x, y, sx, sy, width, 2) - value

    first = np.array([*start, sigma, value.max() * 2 * math.pi * sigma**2])
    first[3] *= max(math.hypot(*start) / sigma / math.sqrt(2 * math.pi), 1.0)
    if not start.any():
        first[:2] = 0.5, 0.1
    fit = optimize.least_squares(off, first, x_scale=[1.0, 1.0, 0.3, abs(first[3]) + 1e-9])
    normal = fit.jac.T @ fit.jac
    variance = 2 * fit.cost / max(len(value) - 4, 1)
    error = np.sqrt(np.diag(np.linalg.pinv(normal))[:2].mean() * variance)
    return Streak(float(fit.x[0]), float(fit.x[1]), float(error), height)


def _blurred_line(x: Floats, y: Floats, sx: float, sy: float, width: float, order: int) -> Floats:
    """A line of sum 1, blurred by a Gaussian: order 1 from -s/2 to s/2; order 2 a triangle, -s to
    s."""
    length = max(math.hypot(sx, sy), 1e-3)
    along, across = (x * sx + y * sy) / length, (x * sy - y * sx) / length
    tall = np.exp(-((across / width) ** 2) / 2) / (width * math.sqrt(2 * math.pi))
    if order == 1:
        ends = [special.ndtr((along + half) / width) for half in (length / 2, -length / 2)]
        return np.asarray((ends[0] - ends[1]) / length * tall)
    # The second integral of a Gaussian, of which a blurred triangle is the second difference.
    t = np.stack([along + length, along, along - length]) / width
    twice = width * (t * special.ndtr(t) + np.exp(-t * t / 2) / math.sqrt(2 * math.pi))
    return np.asarray((twice[0] - 2 * twice[1] + twice[2]) / length**2 * tall)


def _autocorrelation(value: Floats, far: int) -> Floats:
    """Sums over pixels at lags up to `far`, (2 far + 1, 2 far + 1)."""
    shape = [fft.next_fast_len(side + far, real=True) for side in value.shape]
    power = np.abs(fft.rfft2(value.astype(np.float32), shape)) ** 2
    both = fft.irfft2(power, shape)
    lag = np.arange(-far, far + 1)
    return np.asarray(both[np.ix_(lag, lag)], float)


def _width(plan: DetectionPlan) -> float:
    """Pixel, sigma of the autocorrelation of the image of a star at rest."""
    table, step = plan.star.psf.table, 1 / plan.star.psf.oversampling
    at = (np.arange(len(table)) - len(table) // 2) * step
    light = table.sum(axis=0)
    return math.sqrt(2 * float((light * at**2).sum() / light.sum()))


def _line(s: Floats) -> tuple[Floats, Floats]:
    """Points (k,) from the middle of a streak to its end, as fractions of it; and their weights."""
    count = max(math.ceil(math.hypot(*s) * POINTS), 1)
    points = np.arange(count + 1) / count
    return points, (1 - points) / count * np.where(points > 0, 1.0, 0.5)


def _norm(length: float, sigma: float) -> float:
    """Standard deviation of the sum along a line of smoothed white noise of deviation one."""
    points, taper = _line(np.array([length, 0.0]))
    apart = np.subtract.outer(points, points) * length
    # Both halves of the lags have the same numbers: a point and its mirror.
    shared = np.exp(-(apart**2) / (4 * sigma**2)) / (4 * math.pi * sigma**2)
    mirror = np.exp(-((np.add.outer(points, points) * length) ** 2) / (4 * sigma**2))
    shared += mirror / (4 * math.pi * sigma**2)
    return math.sqrt(float(taper @ shared @ taper))


@lru_cache(maxsize=2)
def _lines(far: int, sigma: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Streaks to try: (n, 3) x, y and the first of their points; places, weights, norms."""
    ends, norm, radius = [(0.0, 0.0)], [_norm(0.0, sigma)], TIP
    while radius <= LONGEST_STREAK:
        many = max(math.ceil(math.pi * radius / TIP), 2)
        angle = np.arange(many) * math.pi / many
        ends += [(radius * math.cos(a), radius * math.sin(a)) for a in angle]
        norm += [_norm(radius, sigma)] * many
        radius += TIP
    first, place, weight = [], [], []
    count = 0
    for s in np.array(ends):
        points, taper = _line(s)
        first.append(count)
        count += len(points)
        place.append(far + np.outer(points, s[::-1]))
        weight.append(taper)
    return (
        np.column_stack([np.array(ends), first]),
        np.concatenate(place).T,
        np.concatenate(weight),
        np.array(norm),
    )
