"""Sample -> centre of gravity of a window that follows the star."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from startrack.detection.robust import around
from startrack.detection.sample import ROW, Image, Sample, pixel_noise
from startrack.values import Floats

ROUNDS = 5
STEPS = 12
NARROW = 1  # pixel, half side of the smallest window
LEAST_LEFT = 0.5  # below that the window is too small for its star


def gravity(sample: Sample, uncut: bool) -> Floats:
    """Measure every peak in a square window, and drop those whose window runs away.

        F = sum(s_i),   g = sum(r_i s_i) / F,   s_i = image_i - background
        cov(g) = sum(var_i (r_i - g)(r_i - g)^T) / F^2

    The background is a plane through a ring, var_i an empty pixel's noise plus the star's shot
    noise. The window cuts the star's wings unevenly, which pulls g towards the window's centre.

    Source: linear propagation of independent pixel noise.

    uncut    take the window's pull back as for a Gaussian star, and widen the covariance by
             what that costs
    Returns  (n, 9): x, y, flux, its sigma, xx, xy, yy, window's column and row; NaN up to yy
             where the window runs away or holds no light
    Errors   model: the pixels average a sharp star, which moves g by up to 0.0023 pixel for a
             Gaussian of sigma 0.5 pixel, 0.054 for 0.3. A star whose sigma exceeds a fifth of
             the window leaves light in the ring, which keeps up to a third of the window's pull.
             The covariance holds neither. A faint star whose window shows no light is measured
             in 3 x 3 pixels.
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
        sigma, xx, xy, yy = _errors(
            image, u, v, gx, gy, half, background, noise, error, shot, saturation
        )
        cx, cy, ax, ay = gx, gy, 1.0, 1.0
        if uncut:
            cx, ax = _uncut(gx, mx, half)
            cy, ay = _uncut(gy, my, half)
        table[i, 0], table[i, 1], table[i, 2], table[i, 3] = u + cx, v + cy, flux, sigma
        table[i, 4] = ax * ax * xx / flux**2
        table[i, 5] = ax * ay * xy / flux**2
        table[i, 6] = ay * ay * yy / flux**2
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
def _uncut(mean: float, variance: float, half: int) -> tuple[float, float]:
    """Mean of a Gaussian star along one axis, from what a window shows of it.

    For the standard normal law between a and b, with Z = Phi(b) - Phi(a):

        pull = (phi(b) - phi(a)) / Z,   left = 1 - (b phi(b) - a phi(a)) / Z - pull^2
        mean = c - sigma pull,          variance = sigma^2 left

    solved for c and sigma by iteration, which contracts, because left is the slope of the mean.
    A pixel's own variance 1/12 is no part of it.

    Source: moments of the doubly truncated normal law; Johnson, Kotz and Balakrishnan,
    Continuous Univariate Distributions 1 (1994), chapter 13, section 10.1.

    Returns  c, pixel; 1 / left, by which noise grows on the way from the mean to c
    """
    seen = variance - 1 / 12
    if not seen > 0:
        return mean, 1.0
    c, left = mean, 1.0
    edge = half + 0.5
    for _ in range(STEPS):
        sigma = math.sqrt(seen / left)
        a, b = (-edge - c) / sigma, (edge - c) / sigma
        pa, pb = math.exp(-a * a / 2), math.exp(-b * b / 2)
        z = math.sqrt(math.pi / 2) * (math.erf(b / math.sqrt(2)) - math.erf(a / math.sqrt(2)))
        pull = (pb - pa) / z
        left = max(1 - (b * pb - a * pa) / z - pull**2, LEAST_LEFT)
        c = mean + sigma * pull
    return c, 1 / left


@njit(cache=True, error_model="numpy")
def _errors(
    image: Image,
    u: int,
    v: int,
    gx: float,
    gy: float,
    half: int,
    background: float,
    noise: float,
    error: float,
    shot: float,
    saturation: float,
) -> tuple[float, float, float, float]:
    """Standard deviation of the flux, and sums xx, xy, yy of variance times offset squared.

    gx, gy  centre of gravity from (u, v), pixel
    noise   of an empty pixel;  error  of the background, digital number
    shot    variance per digital number of light, digital number
    """
    variance, xx, xy, yy = 0.0, 0.0, 0.0, 0.0
    for j in range(-half, half + 1):
        for i in range(-half, half + 1):
            signal = image[v + j, u + i] - background
            # Negative signals stay in, or faint stars would seem to have more shot noise.
            pixel = max(noise**2 + shot * signal, 0.0)
            if image[v + j, u + i] >= saturation:
                pixel = max(pixel, signal**2)  # the light is unknown, at least this much
            dx, dy = i - gx, j - gy
            variance += pixel
            xx += pixel * dx * dx
            xy += pixel * dx * dy
            yy += pixel * dy * dy
    # An error of the background moves all pixels of the window together.
    whole = (error * (2 * half + 1) ** 2) ** 2
    return (
        math.sqrt(variance + whole),
        xx + whole * gx * gx,
        xy + whole * gx * gy,
        yy + whole * gy * gy,
    )
