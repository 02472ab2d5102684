"""Sample -> centre of gravity under a Gaussian weight that is moved until it sits on the star."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import Floats, kernel
from startrack.detection.gravity import gravity
from startrack.detection.robust import around
from startrack.detection.sample import (
    FLUX,
    WINDOW_X,
    WINDOW_Y,
    XX,
    XY,
    YY,
    Sample,
    X,
    Y,
    pixel_noise,
)

ROUNDS = 20
CLOSE = 1e-5  # pixel; a last step of that length
LONGEST = 0.5  # pixel


def weighted(sample: Sample, sigma: float) -> Floats:
    """Solve for the position c where the sum of the weighted offsets is zero, by Newton's method.

        sum(w_i s_i (r_i - c)) = 0,   w_i = exp(-|r_i - c|^2 / (2 sigma^2))
        cov(c) = sum(var_i w_i^2 (r_i - c)(r_i - c)^T) / slope^2

    Source: Bertin's windowed positions (SExtractor's manual, XWIN_IMAGE), with the true slope in
    the place of his factor 2, which holds where the star is as wide as the weight.

    sigma    pixel, of the weight; best that of the stars
    Returns  as `gravity`, whose flux it keeps
    Accuracy  model: pixels average the star, which moves c by at most what `gravity` has.
    """
    return np.asarray(_weighted(sample, gravity(sample, True), sigma))


@kernel
def _weighted(sample: Sample, table: Floats, sigma: float) -> Floats:
    image, half, floor = sample.image, sample.half, sample.floor
    for i in range(len(sample.x)):
        if np.isnan(table[i, FLUX]):
            continue
        u, v = int(table[i, WINDOW_X]), int(table[i, WINDOW_Y])
        background, slope_x, slope_y, spread, _ = around(image, u, v, half, floor)
        noise, shot = pixel_noise(
            background, spread, floor, sample.electrons_per_dn, sample.offset, sample.read_noise
        )
        cx, cy = table[i, X] - u, table[i, Y] - v
        settled = False
        for _ in range(ROUNDS):
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
        # Where the weight does not settle, the plain centre of gravity stays.
        if settled and max(abs(cx), abs(cy)) <= half:
            table[i, X], table[i, Y] = u + cx, v + cy
            table[i, XX], table[i, XY], table[i, YY] = xx / mx**2, xy / (mx * my), yy / my**2
    return table
