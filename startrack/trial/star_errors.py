"""Case -> errors of single stars over their magnitude, cause by cause."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import Floats
from startrack.design import Case
from startrack.trial.conditions import dark
from startrack.trial.star_response import chart, lone, magnitudes, pattern

TYPICAL = 4.5  # G of a star that counts much in most trackers
SHOT, READ, METHOD = "shot noise", "read noise", "centroid method"


class Errors(NamedTuple):
    """Of single stars.

    magnitude  (m,) G of a sunlike star
    kept       (m,) fraction of the places at which the tracker keeps a star
    stated     (m, 2, 2) pixel^2, by the tracker
    random     (m, 2, 2) pixel^2 by cause, scatter over places, times and devices
    mean       (m, 2) pixel, over the places, of the centroid's method
    """

    magnitude: Floats
    kept: Floats
    stated: Floats
    random: dict[str, Floats]
    mean: Floats


@lru_cache(maxsize=8)
def errors(case: Case) -> Errors:
    """What single stars of each magnitude err by, cause by cause."""
    detector = case.instrument.detector
    magnitude = magnitudes(case, case.believed_catalog.limit_g)
    plain = chart(case, magnitude)
    method = _mean(plain.offset)
    # The tracker states too much of a saturated star, on purpose.
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
    shape = (len(magnitude), *lone(case).shape)
    if detector.prnu:
        gain = 1 + detector.prnu / detector.binning * pattern("photo response", shape)
        random["PRNU"] = _moment(chart(case, magnitude, gain=gain).offset - plain.offset)
    _, spread = dark(detector)
    if spread:
        extra = spread * pattern("dark current", shape)
        random["DSNU"] = _moment(chart(case, magnitude, extra=extra).offset - plain.offset)
    kept = np.isfinite(plain.offset[..., 0]).mean(axis=1)
    return Errors(magnitude, kept, _mean(plain.covariance), random, method)


def _mean(values: Floats) -> Floats:
    """Over the places (second axis) at which a star was kept.

    Where none was, of the nearest magnitude that has some, for what lies between two magnitudes
    is read from both; zero where no star of any magnitude was kept, which counts nowhere.
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
    """Pixel per axis that stars of a magnitude err by without noise: what stays in their pixels.

    magnitude  (...) G of sunlike stars
    Returns    (...) root mean square over places in the pixel and over devices
    """
    still = sum(one for name, one in star.random.items() if name not in (SHOT, READ))
    variance = np.trace(still, axis1=1, axis2=2) / 2
    # Dark current counts for more the fainter a star is, by powers of its light.
    return np.exp(np.interp(magnitude, star.magnitude, np.log(np.maximum(variance, 1e-16)) / 2))
