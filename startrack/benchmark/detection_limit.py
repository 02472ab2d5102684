"""The share of stars that the best of all tests finds, their places known."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import norm

from startrack.benchmark.starfield import BACKGROUND, READ_NOISE, SIDE, stars_at

Floats = NDArray[np.float64]

FALSE = 0.05  # spots a frame that are allowed


def limit(flux: float, sigma: float, false: float = FALSE) -> float:
    """Share of stars that the best test of Neyman and Pearson finds whose place is known.

    The ratio of likelihoods of Poisson's counts with read noise, taken for more light, is a sum
    of the pixels with the weights log(1 + flux p / (background + read noise^2)). Its tails come
    from its cumulants by the saddle point, which is good to a percent (Lugannani and Rice, 1980).
    A test in every pixel may be wrong in `false` of a frame.
    """
    extra = READ_NOISE**2 + 1 / 12
    found = []
    for p in stars_at(sigma, 4):
        weight = np.log1p(flux * p / (BACKGROUND + extra))
        weight /= np.sqrt((BACKGROUND + extra) * (weight @ weight))
        empty = partial(_exceeds, weight, np.full(p.size, BACKGROUND), extra)
        level = brentq(lambda t: np.log(empty(t) * SIDE**2 / false), 3.0, 9.0)  # noqa: B023
        light = BACKGROUND + flux * p
        found.append(_exceeds(weight, light, extra, level - flux * (weight @ p)))
    return float(np.mean(found))


def _exceeds(weight: Floats, light: Floats, extra: float, level: float) -> float:
    """Probability that weighted counts of mean `light` exceed their mean by more than `level`."""

    def cumulants(s: float) -> tuple[float, float, float]:
        grown = np.exp(s * weight)
        more = extra * (weight @ weight)
        value = light @ (grown - 1 - s * weight) + s * s * more / 2
        slope = (light * weight) @ (grown - 1) + s * more
        return float(value), float(slope), float((light * weight**2) @ grown + more)

    s = float(brentq(lambda s: cumulants(s)[1] - level, -40.0, 40.0))
    value, _, bend = cumulants(s)
    if abs(s) < 1e-4:
        return 0.5
    root, step = np.sign(s) * np.sqrt(2 * (s * level - value)), s * np.sqrt(bend)
    return float(norm.sf(root) + norm.pdf(root) * (1 / step - 1 / root))
