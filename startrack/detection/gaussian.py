"""Sample -> the Gaussian, integrated over pixels, that fits every star best, width and all."""

from __future__ import annotations

import math

import numpy as np

from startrack.detection.fit import Model, fitted
from startrack.detection.sample import Sample
from startrack.values import Floats

NO_TABLE = np.empty((0, 0))


def gaussian(sample: Sample, sigma: float) -> Floats:
    """Fit x, y, flux, background and the star's sigma, by Fisher's scoring.

    It needs no PSF, and keeps the Cramer-Rao bound where stars are round and Gaussian, whatever
    their width.

    sigma    pixel, first guess, which also sets the window: 3 sigma and half a pixel
    Returns  as `gravity`; NaN where the fit runs away
    Errors   model: a star that is no Gaussian is fitted by its core.
    """
    half = max(sample.half, math.ceil(3 * sigma + 0.5))
    return np.asarray(fitted(sample, Model(NO_TABLE, 1, half, half, half, float(sigma))))
