"""Case -> errors of single stars over their magnitude, cause by cause."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from startrack.budget.causes import METHOD, READ, SHOT, dark_spread
from startrack.budget.chart import chart, detected, lone, magnitudes, pattern
from startrack.budget.fields import Response
from startrack.case import Case
from startrack.values import Floats

TYPICAL = 4.5  # G of a star that counts much in most trackers
FINE = 0.05  # magnitude between two entries of a response


class Errors(NamedTuple):
    """Of single stars.

    magnitude  (m,) G of a sunlike star
    kept       (m,) share of the places at which the tracker keeps a star
    stated     (m, 2, 2) pixel^2, by the tracker
    random     (m, 2, 2) pixel^2 by cause, scatter over places, times and devices
    mean       (m, 2) pixel, over the places, of the centroid's method
    """

    magnitude: Floats
    kept: Floats
    stated: Floats
    random: dict[str, Floats]
    mean: Floats


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
    spread = dark_spread(detector)
    if spread:
        extra = spread * pattern("dark current", shape)
        random["DSNU"] = _moment(chart(case, magnitude, extra=extra).offset - plain.offset)
    kept = np.isfinite(plain.offset[..., 0]).mean(axis=1)
    return Errors(magnitude, kept, _mean(plain.covariance), random, method)


def _mean(values: Floats) -> Floats:
    """Over the places (second axis) at which a star was kept; large where none was."""
    kept = np.isfinite(values)
    total = np.where(kept, values, 0).sum(axis=1)
    return total / np.maximum(kept.sum(axis=1), 1)


def _moment(offset: Floats) -> Floats:
    """Second moments (m, 2, 2) of offsets (m, p, 2)."""
    return _mean(offset[..., :, None] * offset[..., None, :])


def lasting(star: Errors, magnitude: float = TYPICAL) -> float:
    """Pixel per axis that a star of a magnitude errs by without noise: what stays in its pixels.

    What a tracker should at least believe of its centroids beside their noise
    (`Attitude.centroid_floor`); neighbours and the rest of the distortion come on top.
    """
    still = sum(one for name, one in star.random.items() if name not in (SHOT, READ))
    variance = np.trace(still, axis1=1, axis2=2) / 2
    return float(np.sqrt(np.interp(magnitude, star.magnitude, variance)))


def response(case: Case, star: Errors) -> Response:
    """The same as a table of small steps, as `propagate` takes it."""
    grid = np.arange(star.magnitude[0], star.magnitude[-1] + FINE / 2, FINE)
    floor = case.tracker.attitude.centroid_floor**2 * np.eye(2)
    return Response(
        float(grid[0]),
        FINE,
        detected(case, grid) * np.interp(grid, star.magnitude, star.kept),
        _fine(star.magnitude, star.stated, grid) + floor,
        np.stack([_fine(star.magnitude, one, grid) for one in star.random.values()]),
    )


def _fine(magnitude: Floats, table: Floats, grid: Floats) -> Floats:
    """Covariances between magnitudes, straight lines in the logarithm; (k, 2, 2) pixel^2."""
    xx, yy = (np.maximum(table[:, a, a], 1e-16) for a in (0, 1))
    correlation = np.interp(grid, magnitude, np.clip(table[:, 0, 1] / np.sqrt(xx * yy), -1, 1))
    x, y = (np.exp(np.interp(grid, magnitude, np.log(each) / 2)) for each in (xx, yy))
    cross = correlation * x * y
    return np.stack([x * x, cross, cross, y * y], axis=-1).reshape(-1, 2, 2)
