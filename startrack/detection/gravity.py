"""Sample -> centre of gravity of a window that follows the star."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from startrack.core import Floats
from startrack.detection.robust import around
from startrack.detection.sample import ROW, Image, Sample, pixel_noise

ROUNDS = 5
STEPS = 12
NARROW = 1  # pixel, half side of the smallest window
PLAIN = (1.0, 0.0)  # a place that is the centre of gravity itself
LEAST_LEFT = 0.5  # below that the window is too small for its star


def gravity(sample: Sample, uncut: bool) -> Floats:
    """Measure every peak in a square window, and drop those whose window runs away.

        F = sum(s_i),   g = sum(r_i s_i) / F,   s_i = image_i - background
        cov(g) = sum(var_i (r_i - g)(r_i - g)^T) / F^2

    The background is a plane through a ring, var_i an empty pixel's noise plus the star's shot
    noise. The window cuts the star's wings unevenly, which pulls g towards the window's centre.

    Source: linear propagation of independent pixel noise.

    uncut    take the window's pull back as for a Gaussian star, and widen the covariance by
             what that costs, to first order
    Returns  (n, 9): x, y, flux, its sigma, xx, xy, yy, window's column and row; NaN up to yy
             where the window runs away or holds no light
    Accuracy  model: the pixels average a sharp star, which moves g by up to 0.0023 pixel for a
              Gaussian of sigma 0.5 pixel, 0.054 for 0.3. A star whose sigma exceeds a fifth of the
              window leaves light in the ring, which keeps up to a third of the window's pull. The
              covariance holds neither. A faint star whose window shows no light is measured in 3 x
              3 pixels.
    """
    return _gravity(*sample, uncut)


@njit(cache=True, error_model="numpy")
def _gravity(  # type: ignore[no-untyped-def]
    image, dead, x, y, whole, floor, electrons_per_dn, offset, read_noise, saturation, uncut
):
    rows, columns = image.shape
    table = np.full((len(x), ROW), np.nan)
    for i in range(len(x)):
        u, v, half = x[i], y[i], whole
        lost = False
        for k in range(ROUNDS):
            background, slope_x, slope_y, spread, count = around(image, u, v, half, floor)
            flux, gx, gy, mx, my = moments(image, u, v, half, background, slope_x, slope_y)
            lost = not (flux > 0 and abs(gx) <= half and abs(gy) <= half)
            if lost and half > NARROW:
                # A faint star may drown in its window's noise, and is then looked for in its core.
                u, v, half = x[i], y[i], NARROW
                continue
            # A star on the border of two pixels may go to and fro; either window serves.
            if lost or (abs(gx) <= 0.5 and abs(gy) <= 0.5) or k == ROUNDS - 1:
                break
            u = min(max(u + round(gx), half), columns - 1 - half)
            v = min(max(v + round(gy), half), rows - 1 - half)
            if abs(u - x[i]) > half or abs(v - y[i]) > half:
                lost = True
                break
        table[i, 7], table[i, 8] = u, v
        if lost:
            continue
        noise, shot = pixel_noise(background, spread, floor, electrons_per_dn, offset, read_noise)
        error = spread / math.sqrt(count)  # of the background
        cx, cy, answer_x, answer_y = gx, gy, PLAIN, PLAIN
        if uncut:
            cx, answer_x = _uncut(gx, mx, half)
            cy, answer_y = _uncut(gy, my, half)
        sigma, xx, xy, yy = _errors(
            image, u, v, gx, gy, mx, my, answer_x, answer_y, half, background, noise, error, shot,
            saturation,
        )  # fmt: skip
        table[i, 0], table[i, 1], table[i, 2], table[i, 3] = u + cx, v + cy, flux, sigma
        table[i, 4], table[i, 5], table[i, 6] = xx / flux**2, xy / flux**2, yy / flux**2
    return table


@njit(cache=True, error_model="numpy")
def moments(
    image: Image, u: int, v: int, half: int, background: float, slope_x: float, slope_y: float
) -> tuple[float, float, float, float, float]:
    """Flux, centre of gravity from (u, v), and variance along x and y, within the window."""
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
    return flux, gx, gy, sxx / flux - gx * gx, syy / flux - gy * gy


@njit(cache=True, error_model="numpy")
def _uncut(mean: float, variance: float, half: int) -> tuple[float, tuple[float, float]]:
    """Mean of a Gaussian star along one axis, from what a window shows of it.

    For the standard normal law between a and b, with Z = Phi(b) - Phi(a):

        pull = (phi(b) - phi(a)) / Z,   left = 1 - (b phi(b) - a phi(a)) / Z - pull^2
        mean = c - sigma pull,          variance = sigma^2 left

    solved for c and sigma by iteration, which contracts, because left is the slope of the mean.
    A pixel's own variance 1/12 is no part of it.

    Source: moments of the doubly truncated normal law; Johnson, Kotz and Balakrishnan,
    Continuous Univariate Distributions 1 (1994), chapter 13, section 10.1.

    Returns  c, pixel; its derivatives by the mean and by the variance
    """
    seen = variance - 1 / 12
    if not seen > 0:
        return mean, PLAIN
    c, left = mean, 1.0
    edge = half + 0.5
    a, b, pa, pb, z, sigma = 0.0, 0.0, 0.0, 0.0, 1.0, 1.0
    for _ in range(STEPS):
        sigma = math.sqrt(seen / left)
        a, b = (-edge - c) / sigma, (edge - c) / sigma
        pa, pb = math.exp(-a * a / 2), math.exp(-b * b / 2)
        z = math.sqrt(math.pi / 2) * (math.erf(b / math.sqrt(2)) - math.erf(a / math.sqrt(2)))
        pull = (pb - pa) / z
        left = max(1 - (b * pb - a * pa) / z - pull**2, LEAST_LEFT)
        c = mean + sigma * pull
    return c, _answer(a, b, pa / z, pb / z, sigma, left)


@njit(cache=True, error_model="numpy")
def _answer(
    a: float, b: float, pa: float, pb: float, sigma: float, left: float
) -> tuple[float, float]:
    """How c follows the mean and the variance that a window shows.

    With the moments m1 .. m4 of the standard normal law t between a and b,

        d mean = left dc + k3 dsigma,   d variance = sigma (s3 dc + (k4 - 2 m1 k3) dsigma)
        k3 = cov(t, t^2),   k4 = var t^2,   s3 = mean (t - m1)^3

    as derivatives of a law exp(-(x - c)^2 / 2 sigma^2) are covariances with t and t^2; solved for
    dc. Both fall and rise with the same pixels, so that a variance that is known from the star
    itself takes noise away from c beside the window's middle.
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


@njit(cache=True, error_model="numpy")
def _errors(
    image: Image,
    u: int,
    v: int,
    gx: float,
    gy: float,
    mx: float,
    my: float,
    answer_x: tuple[float, float],
    answer_y: tuple[float, float],
    half: int,
    background: float,
    noise: float,
    error: float,
    shot: float,
    saturation: float,
) -> tuple[float, float, float, float]:
    """Standard deviation of the flux, and sums xx, xy, yy of variance times answer squared.

    gx, gy  centre of gravity from (u, v), pixel;  mx, my  variance about it, pixel^2
    answer  of the place, to the centre of gravity and to the variance
    noise   of an empty pixel;  error  of the background, digital number
    shot    variance per digital number of light, digital number
    """
    variance, xx, xy, yy, sum_x, sum_y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(-half, half + 1):
        y = answer_y[0] * (j - gy) + answer_y[1] * ((j - gy) ** 2 - my)
        for i in range(-half, half + 1):
            signal = image[v + j, u + i] - background
            # Negative signals stay in, or faint stars would seem to have more shot noise.
            pixel = max(noise**2 + shot * signal, 0.0)
            if image[v + j, u + i] >= saturation:
                pixel = max(pixel, signal**2)  # the light is unknown, at least this much
            x = answer_x[0] * (i - gx) + answer_x[1] * ((i - gx) ** 2 - mx)
            variance += pixel
            xx += pixel * x * x
            xy += pixel * x * y
            yy += pixel * y * y
            sum_x += x
            sum_y += y
    # An error of the background moves all pixels of the window together.
    whole = error**2
    return (
        math.sqrt(variance + whole * (2 * half + 1) ** 4),
        xx + whole * sum_x * sum_x,
        xy + whole * sum_x * sum_y,
        yy + whole * sum_y * sum_y,
    )
