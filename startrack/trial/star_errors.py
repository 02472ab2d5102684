"""Case -> errors of single stars over their magnitude, cause by cause."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import Floats
from startrack.design import Case
from startrack.trial.conditions import dark_residual
from startrack.trial.star_response import chart, magnitudes, pattern, point_images

TYPICAL = 4.5  # G of a star of high weight in most trackers; chosen by hand
SHOT, READ, METHOD = "shot noise", "read noise", "centroid method"


class Errors(NamedTuple):
    """Of single stars.

    magnitude  (m,) G of a sunlike star
    kept       (m,) fraction of the positions in the pixel at which the tracker keeps a star
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
    method = _mean(plain.offset)
    # The tracker overstates the covariance of a saturated star on purpose.
    bold = replace(case.tracker, detection=replace(case.tracker.detection, saturation=None))
    noise, shot = (
        _mean(chart(replace(case, tracker=bold), magnitude, noisy=noisy).covariance)
        for noisy in (True, False)
    )
    random = {
        SHOT: shot,
        READ: noise - shot,
        METHOD: _moment(plain.offset - method[:, None]),
    }
    shape = (len(magnitude), *point_images(case).shape)
    if detector.prnu:
        gain = 1 + detector.prnu / detector.binning * pattern("photo response", shape)
        random["PRNU"] = _moment(chart(case, magnitude, gain=gain).offset - plain.offset)
    spread = dark_residual(detector, case.tracker.detection.dark_map)
    if spread:
        extra = spread * pattern("dark current", shape)
        random["DSNU"] = _moment(chart(case, magnitude, extra=extra).offset - plain.offset)
    kept = np.isfinite(plain.offset[..., 0]).mean(axis=1)
    return Errors(magnitude, kept, _mean(plain.covariance), random, method)


def _mean(values: Floats) -> Floats:
    """Mean over the positions (second axis) at which a star was kept.

    Where none was, that of the nearest magnitude with some, because values between two magnitudes
    are interpolated; zero where no star of any magnitude was kept, where it is never used.
    """
    kept = np.isfinite(values)
    total, count = np.where(kept, values, 0).sum(axis=1), kept.sum(axis=1)
    mean = total / np.maximum(count, 1)
    row = np.arange(len(mean))
    some = np.flatnonzero(count.reshape(len(mean), -1).any(axis=1))
    if len(some):
        mean = mean[some[np.abs(row[:, None] - some).argmin(axis=1)]]
    return np.asarray(mean)


def _moment(offset: Floats) -> Floats:
    """Second moments (m, 2, 2) of offsets (m, p, 2)."""
    return _mean(offset[..., :, None] * offset[..., None, :])


def lasting(star: Errors, magnitude: Floats | float = TYPICAL) -> Floats:
    """Rms error per axis (pixel) of stars without noise: what is constant at their pixels.

    magnitude  (...) G of sunlike stars
    Returns    (...) root mean square over positions in the pixel and over devices
    """
    still = sum(one for name, one in star.random.items() if name not in (SHOT, READ))
    variance = np.trace(still, axis1=1, axis2=2) / 2
    # The error by dark current grows with a power of magnitude: interpolate its logarithm.
    return np.exp(np.interp(magnitude, star.magnitude, np.log(np.maximum(variance, 1e-16)) / 2))
