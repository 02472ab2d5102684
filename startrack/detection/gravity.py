"""Sample -> centre of gravity, of a window that follows the star or under a Gaussian weight.

A Sample is the input of every centroid: the image, the peaks and the noise of a pixel.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Ints, Singles, kernel
from startrack.detection.robust import around

# Columns of the table (n, COLUMNS) in which each centroid method writes a row per star: position,
# flux and its sigma, covariance of the position, and the pixel that the window is centred on.
X, Y, FLUX, FLUX_SIGMA, XX, XY, YY, WINDOW_X, WINDOW_Y = range(9)
COLUMNS = 9
USUAL_NOISE = 10.0  # electron, by hand; errors of bright stars are within 2 for 2.5 to 40
UNEVEN = 1.6  # by hand: the noise of a ring never exceeds the gain model by more by chance


class Sample(NamedTuple):
    """Input of the centroids, in digital numbers; the pivot is subtracted from levels and `image`.

    image             (rows, columns)
    dead              as for Pixels; empty where none is
    x, y              (n,) pixel, peaks
    half              pixel, half side of the window
    floor             least noise of a pixel
    light             digital number of light over its variance; NaN where unknown
    offset            of an empty pixel
    read_noise        NaN where unknown
    saturation        from which on a pixel's light is unknown
    """

    image: Singles
    dead: NDArray[np.uint8]
    x: Ints
    y: Ints
    half: int
    floor: float
    light: float
    offset: float
    read_noise: float
    saturation: float


@kernel
def pixel_noise(sample: Sample, background: float, spread: float) -> tuple[float, float]:
    """Noise of an empty pixel, and the variance that each digital number of light adds.

        variance = read_noise^2 + (background - offset) / gain + step^2 / 12

    if all of it is known. Otherwise, and for an uneven ring, it is the spread of the ring around
    the star. An unknown gain is estimated from the background as if all of it were light. A
    background below its noise, as of an image from which it was subtracted, says nothing of the
    gain: the noise is assumed to be USUAL_NOISE.

    spread   of the pixels around
    Returns  digital number; digital number
    """
    shot, noise, light = 1 / sample.light, spread, background - sample.offset
    if np.isnan(shot):
        shot = noise**2 / max(light if light > noise else USUAL_NOISE * noise, 1e-30)
    elif not np.isnan(sample.read_noise):
        variance = sample.read_noise**2 + max(light, 0.0) * shot + sample.floor**2
        if spread < UNEVEN * math.sqrt(variance):
            noise = math.sqrt(variance)
    return noise, shot


ROUNDS = 5
STEPS = 12
NARROW = 1  # pixel, half side of the smallest window
UNCORRECTED = (1.0, 0.0)  # derivatives of a position that is the centre of gravity itself
LEAST_LEFT = 0.5  # of the variance within the window; below, the window is too small for its star


def gravity(sample: Sample, uncut: bool) -> Floats:
    """Measure every peak in a square window, and drop peaks whose window moves off the star.

        F = sum(s_i),   g = sum(r_i s_i) / F,   s_i = image_i - background
        cov(g) = sum(var_i (r_i - g)(r_i - g)^T) / F^2

    The background is a plane through a ring. var_i is an empty pixel's noise plus the star's shot
    noise. The window cuts the star's wings unevenly, which biases g towards the window's centre.

    Source: linear propagation of independent pixel noise.

    uncut    correct this bias as for a Gaussian star, and enlarge the covariance by the noise of
             that correction, to first order
    Returns  (n, COLUMNS); NaN up to YY where the window leaves its star
             or holds no light
    Accuracy  model: averaging of a sharp star over pixels moves g by up to 0.0023 pixel for a
              Gaussian of sigma 0.5 pixel, and 0.054 for 0.3. If sigma exceeds a fifth of the
              window, the ring contains light, and up to a third of the bias remains. The covariance
              includes neither error. A faint star whose window shows no light is measured in 3 x 3
              pixels.
    """
    return np.asarray(_gravity(sample, uncut))


class Moments(NamedTuple):
    """Moments of the signal in a window: its sum, centre of gravity and variance about that.

    x, y                    pixel from the middle of the window
    variance_x, variance_y  pixel^2
    """

    flux: float
    x: float
    y: float
    variance_x: float
    variance_y: float


class PixelLaw(NamedTuple):
    """Background and noise of the pixels about a star, digital number.

    background  of an empty pixel;  error  its standard deviation
    noise       of an empty pixel
    shot        variance for each digital number of light
    saturation  from which on a pixel's light is unknown
    """

    background: float
    error: float
    noise: float
    shot: float
    saturation: float


@kernel
def _gravity(sample: Sample, uncut: bool) -> Floats:
    """The rows of `gravity`, one star after the other."""
    image, x, y = sample.image, sample.x, sample.y
    rows, columns = image.shape
    table = np.full((len(x), COLUMNS), np.nan)
    for i in range(len(x)):
        u, v, half = x[i], y[i], sample.half
        lost = False
        for k in range(ROUNDS):
            level, slope_x, slope_y, spread, count = around(image, u, v, half, sample.floor)
            seen = moments(image, u, v, half, level, slope_x, slope_y)
            lost = not (seen.flux > 0 and abs(seen.x) <= half and abs(seen.y) <= half)
            if lost and half > NARROW:
                # The noise of the window may exceed a faint star; then its core is measured.
                u, v, half = x[i], y[i], NARROW
                continue
            # The window of a star on the border of two pixels may alternate; both windows are
            # valid.
            if lost or (abs(seen.x) <= 0.5 and abs(seen.y) <= 0.5) or k == ROUNDS - 1:
                break
            u = min(max(u + round(seen.x), half), columns - 1 - half)
            v = min(max(v + round(seen.y), half), rows - 1 - half)
            if abs(u - x[i]) > half or abs(v - y[i]) > half:
                lost = True
                break
        table[i, WINDOW_X], table[i, WINDOW_Y] = u, v
        if lost:
            continue
        noise, shot = pixel_noise(sample, level, spread)
        law = PixelLaw(level, spread / math.sqrt(count), noise, shot, sample.saturation)
        cx, cy, by_x, by_y = seen.x, seen.y, UNCORRECTED, UNCORRECTED
        if uncut:
            cx, by_x = _uncut(seen.x, seen.variance_x, half)
            cy, by_y = _uncut(seen.y, seen.variance_y, half)
        sigma, xx, xy, yy = _errors(image, u, v, half, seen, by_x, by_y, law)
        flux = seen.flux
        table[i, X], table[i, Y] = u + cx, v + cy
        table[i, FLUX], table[i, FLUX_SIGMA] = flux, sigma
        table[i, XX], table[i, XY], table[i, YY] = xx / flux**2, xy / flux**2, yy / flux**2
    return table


@kernel
def moments(
    image: Singles, u: int, v: int, half: int, background: float, slope_x: float, slope_y: float
) -> Moments:
    """Moments in the window about (u, v), above a background plane."""
    flux, sx, sy, sxx, syy = 0.0, 0.0, 0.0, 0.0, 0.0
    for dy in range(-half, half + 1):
        for dx in range(-half, half + 1):
            signal = image[v + dy, u + dx] - (background + slope_x * dx + slope_y * dy)
            flux += signal
            sx += signal * dx
            sy += signal * dy
            sxx += signal * dx * dx
            syy += signal * dy * dy
    gx, gy = sx / flux, sy / flux
    return Moments(flux, gx, gy, sxx / flux - gx * gx, syy / flux - gy * gy)


@kernel
def _uncut(mean: float, variance: float, half: int) -> tuple[float, tuple[float, float]]:
    """Mean of a Gaussian star along one axis, from its moments within a window.

    For the standard normal law between a and b, with Z = Phi(b) - Phi(a):

        pull = (phi(b) - phi(a)) / Z,   left = 1 - (b phi(b) - a phi(a)) / Z - pull^2
        mean = c - sigma pull,          variance = sigma^2 left

    solved for c and sigma by iteration, which contracts, because left is the slope of the mean.
    The variance 1/12 of a pixel is subtracted first.

    Source: moments of the doubly truncated normal law; Johnson, Kotz and Balakrishnan,
    Continuous Univariate Distributions 1 (1994), chapter 13, section 10.1.

    Returns  c, pixel; its derivatives by the mean and by the variance
    """
    seen = variance - 1 / 12
    if not seen > 0:
        return mean, UNCORRECTED
    c, left = mean, 1.0
    edge = half + 0.5
    a, b, pa, pb, z, sigma = 0.0, 0.0, 0.0, 0.0, 1.0, 1.0
    for _ in range(STEPS):
        before = c, left
        sigma = math.sqrt(seen / left)
        a, b = (-edge - c) / sigma, (edge - c) / sigma
        pa, pb = math.exp(-a * a / 2), math.exp(-b * b / 2)
        z = math.sqrt(math.pi / 2) * (math.erf(b / math.sqrt(2)) - math.erf(a / math.sqrt(2)))
        pull = (pb - pa) / z
        left = max(1 - (b * pb - a * pa) / z - pull**2, LEAST_LEFT)
        c = mean + sigma * pull
        if before == (c, left):
            break  # converged to the last digit
    return c, _derivatives(a, b, pa / z, pb / z, sigma, left)


@kernel
def _derivatives(
    a: float, b: float, pa: float, pb: float, sigma: float, left: float
) -> tuple[float, float]:
    """Derivatives of c by the mean and the variance within the window.

    With the moments m1 .. m4 of the standard normal law t between a and b,

        d mean = left dc + k3 dsigma,   d variance = sigma (s3 dc + (k4 - 2 m1 k3) dsigma)
        k3 = cov(t, t^2),   k4 = var t^2,   s3 = mean (t - m1)^3

    as derivatives of a law exp(-(x - c)^2 / 2 sigma^2) are covariances with t and t^2; solved for
    dc. Mean and variance depend on the same pixels: off the middle of the window, an estimate of
    the variance from the star itself removes noise from c.
    """
    m1 = pa - pb
    m2 = 1 + a * pa - b * pb
    m3 = 2 * m1 + a * a * pa - b * b * pb
    m4 = 3 * m2 + a**3 * pa - b**3 * pb
    k3, k4 = m3 - m1 * m2, m4 - m2 * m2
    along = k4 - 2 * m1 * k3
    scale = left * along - k3 * (m3 - 3 * m1 * m2 + 2 * m1**3)
    if left <= LEAST_LEFT or not scale > 0:
        return 1 / left, 0.0
    return along / scale, -k3 / (sigma * scale)


@kernel
def _errors(
    image: Singles,
    u: int,
    v: int,
    half: int,
    seen: Moments,
    by_x: tuple[float, float],
    by_y: tuple[float, float],
    law: PixelLaw,
) -> tuple[float, float, float, float]:
    """Standard deviation of the flux, and sums xx, xy, yy of variance times derivative squared.

    by_x, by_y  derivatives of the position by the centre of gravity and by the variance
    """
    variance, xx, xy, yy, sum_x, sum_y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(-half, half + 1):
        y = by_y[0] * (j - seen.y) + by_y[1] * ((j - seen.y) ** 2 - seen.variance_y)
        for i in range(-half, half + 1):
            signal = image[v + j, u + i] - law.background
            # Negative signals are kept, or the shot noise of faint stars would be overestimated.
            pixel = max(law.noise**2 + law.shot * signal, 0.0)
            if image[v + j, u + i] >= law.saturation:
                pixel = max(pixel, signal**2)  # the light is unknown, but at least this
            x = by_x[0] * (i - seen.x) + by_x[1] * ((i - seen.x) ** 2 - seen.variance_x)
            variance += pixel
            xx += pixel * x * x
            xy += pixel * x * y
            yy += pixel * y * y
            sum_x += x
            sum_y += y
    # An error of the background moves all pixels of the window together.
    common = law.error**2
    return (
        math.sqrt(variance + common * (2 * half + 1) ** 4),
        xx + common * sum_x * sum_x,
        xy + common * sum_x * sum_y,
        yy + common * sum_y * sum_y,
    )


WEIGHTED_ROUNDS = 20
CLOSE = 1e-5  # pixel; a last step of that length
LONGEST = 0.5  # pixel


def weighted(sample: Sample, sigma: float) -> Floats:
    """Solve for the position c where the sum of the weighted offsets is zero, by Newton's method.

        sum(w_i s_i (r_i - c)) = 0,   w_i = exp(-|r_i - c|^2 / (2 sigma^2))
        cov(c) = sum(var_i w_i^2 (r_i - c)(r_i - c)^T) / slope^2

    Source: Bertin's windowed positions (SExtractor's manual, XWIN_IMAGE). His factor 2 is valid if
    the star is as wide as the weight; here it is replaced by the slope of the sum.

    sigma    pixel, of the weight; best as wide as the stars
    Returns  as `gravity`, whose flux it keeps
    Accuracy  model: averaging over pixels moves c by no more than the error of `gravity`.
    """
    return np.asarray(_weighted(sample, gravity(sample, uncut=True), sigma))


@kernel
def _weighted(sample: Sample, table: Floats, sigma: float) -> Floats:
    """The rows of `weighted`, written over those of `gravity`."""
    image, half, floor = sample.image, sample.half, sample.floor
    for i in range(len(sample.x)):
        if np.isnan(table[i, FLUX]):
            continue
        u, v = int(table[i, WINDOW_X]), int(table[i, WINDOW_Y])
        background, slope_x, slope_y, spread, _ = around(image, u, v, half, floor)
        noise, shot = pixel_noise(sample, background, spread)
        cx, cy = table[i, X] - u, table[i, Y] - v
        settled = False
        for _ in range(WEIGHTED_ROUNDS):
            bx, by, mx, my = 0.0, 0.0, 0.0, 0.0
            xx, xy, yy = 0.0, 0.0, 0.0
            for dy in range(-half, half + 1):
                for dx in range(-half, half + 1):
                    value = image[v + dy, u + dx]
                    signal = value - background - slope_x * dx - slope_y * dy
                    ox, oy = dx - cx, dy - cy
                    w = math.exp(-(ox * ox + oy * oy) / (2 * sigma * sigma))
                    bx += w * signal * ox
                    by += w * signal * oy
                    mx += w * signal * (1 - ox * ox / sigma**2)
                    my += w * signal * (1 - oy * oy / sigma**2)
                    variance = max(noise**2 + shot * signal, 0.0)
                    if value >= sample.saturation:
                        variance = max(variance, signal**2)
                    xx += variance * w * w * ox * ox
                    xy += variance * w * w * ox * oy
                    yy += variance * w * w * oy * oy
            if not (mx > 0 and my > 0):
                break
            step_x = min(max(bx / mx, -LONGEST), LONGEST)
            step_y = min(max(by / my, -LONGEST), LONGEST)
            cx, cy = cx + step_x, cy + step_y
            if max(abs(step_x), abs(step_y)) < CLOSE:
                settled = True
                break
        # If the iteration does not converge, the plain centre of gravity stays.
        if settled and max(abs(cx), abs(cy)) <= half:
            table[i, X], table[i, Y] = u + cx, v + cy
            table[i, XX], table[i, XY], table[i, YY] = xx / mx**2, xy / (mx * my), yy / my**2
    return table
