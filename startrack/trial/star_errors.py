"""Case -> errors of single stars over their magnitude, cause by cause."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import Floats
from startrack.design import Case
from startrack.trial.conditions import dark_residual
from startrack.trial.star_response import (
    chart,
    kept_fraction,
    magnitudes,
    noise_covariance,
    pattern,
    point_images,
    without_saturation,
)

LEAST_KEPT = 1e-6  # sum of chances below which a magnitude tells nothing
TYPICAL = 4.5  # G of a star of high weight in most trackers; chosen by hand
SHOT, READ, METHOD = "shot noise", "read noise", "centroid method"


class Errors(NamedTuple):
    """Of single stars.

    magnitude  (m,) G of a sunlike star
    kept       (m,) chance that the tracker measures a detected star and takes it for no hot pixel
    stated     (m, 2, 2) pixel^2, by the tracker
    random     (m, 2, 2) pixel^2 by cause, covariance over positions, times and devices
    mean       (m, 2) pixel, over the positions, of the centroid's method
    """

    magnitude: Floats
    kept: Floats
    stated: Floats
    random: dict[str, Floats]
    mean: Floats


@lru_cache(maxsize=8)
def errors(case: Case) -> Errors:
    """Errors of single stars of each magnitude, cause by cause; kept for the 8 last cases."""
    detector = case.instrument.detector
    magnitude = magnitudes(case, case.believed_catalog.limit_g)
    plain = chart(case, magnitude)
    kept = kept_fraction(case, plain)
    method = mean_of(plain.offset, kept)
    # The tracker overstates the covariance of a saturated star on purpose.
    noise = mean_of(noise_covariance(case, plain), kept)
    bare = chart(without_saturation(case), magnitude, noisy=False, believed=False, once=True)
    shot = mean_of(bare.covariance, kept)
    random = {
        SHOT: shot,
        READ: noise - shot,
        METHOD: moment_of(plain.offset - method[:, None], kept),
    }
    shape = (len(magnitude), *point_images(case).shape)
    if detector.prnu:
        gain = 1 + detector.prnu / detector.binning * pattern("photo response", shape)
        moved = chart(case, magnitude, gain=gain, once=True).offset - plain.once
        random["PRNU"] = moment_of(moved, kept)
    spread = dark_residual(detector, case.tracker.detection.dark_map)
    if spread:
        extra = spread * pattern("dark current", shape)
        moved = chart(case, magnitude, extra=extra, once=True).offset - plain.once
        random["DSNU"] = moment_of(moved, kept)
    stated = mean_of(plain.covariance, kept)
    return Errors(magnitude, kept.mean(axis=1), stated, random, method)


def mean_of(values: Floats, kept: Floats) -> Floats:
    """Mean over the positions (second axis), weighted by the chance (m, p) that a star is kept.

    Where none is, that of the nearest magnitude with some, because values between two magnitudes
    are interpolated; zero where no star of any magnitude was kept, where it is never used.
    """
    weight = kept.reshape(*kept.shape, *[1] * (values.ndim - 2)) * np.isfinite(values)
    total = (weight * np.nan_to_num(values)).sum(axis=1)
    count = weight.sum(axis=1)
    mean = total / np.where(count > 0, count, 1.0)
    row = np.arange(len(mean))
    some = np.flatnonzero((count > LEAST_KEPT).reshape(len(mean), -1).any(axis=1))
    if len(some):
        mean = mean[some[np.abs(row[:, None] - some).argmin(axis=1)]]
    return np.asarray(mean)


def moment_of(offset: Floats, kept: Floats) -> Floats:
    """Second moments (m, 2, 2) of offsets (m, p, 2)."""
    return mean_of(offset[..., :, None] * offset[..., None, :], kept)


def lasting(star: Errors, magnitude: Floats | float = TYPICAL) -> Floats:
    """Rms error per axis (pixel) of stars without noise: what is constant at their pixels.

    magnitude  (...) G of sunlike stars
    Returns    (...) root mean square over positions in the pixel and over devices
    """
    still = sum(one for name, one in star.random.items() if name not in (SHOT, READ))
    variance = np.trace(still, axis1=1, axis2=2) / 2
    # The error by dark current grows with a power of magnitude: interpolate its logarithm.
    return np.exp(np.interp(magnitude, star.magnitude, np.log(np.maximum(variance, 1e-16)) / 2))
