"""Pixels and Candidates -> Spots, by the centroid that the settings ask for."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from startrack.core import Floats, Frame, Ints, Psf, Spots
from startrack.detection.find import Candidates
from startrack.detection.fit import gaussian, likelihood
from startrack.detection.gravity import gravity
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels
from startrack.detection.s_curve import compensate, s_curve
from startrack.detection.sample import Sample, sample
from startrack.detection.weighted import weighted

SAME = 1.0  # pixel; two peaks that lead as near as this to one place are one star

NARROWEST_WEIGHT = 1.0  # pixel


def centroid(
    frame: Frame,
    pixels: Pixels,
    candidates: Candidates,
    settings: Detection,
    psf: Psf,
) -> Spots:
    """Measure every candidate, and drop those that run away or lead to the same star.

    psf      what a star looks like
    Returns  Spots, brightest first
    Raises   those of the files of the four centroids.
    """
    table = measured(sample(frame, pixels, candidates, settings), settings, psf)
    order = np.argsort(-table[:, 2], kind="stable")  # NaN goes last
    return Spots(*_kept(table, order, candidates.area, settings.max_spots))


def measured(stars: Sample, settings: Detection, psf: Psf) -> Floats:
    """One row per candidate, as `gravity` describes it."""
    match settings.centroid:
        case "likelihood":
            return likelihood(stars, psf)
        case "gaussian":
            return gaussian(stars, settings.kernel_sigma)
        case "weighted":
            # Pixels widen a star by their own variance, and show in a narrower weight.
            seen = math.hypot(settings.kernel_sigma, 1 / math.sqrt(12))
            return weighted(stars, max(seen, NARROWEST_WEIGHT))
    table = gravity(stars, uncut=settings.compensation == "gaussian")
    if settings.compensation == "psf":
        compensate(table, s_curve(psf, stars.half))
    return table


@njit(cache=True, error_model="numpy")
def _kept(table, order, area, most):  # type: ignore[no-untyped-def]
    """The columns of Spots, of the rows that `_apart` keeps."""
    chosen = order[_apart(table, order, most)]
    x, y, flux, snr = np.empty((4, len(chosen)))
    covariance = np.empty((len(chosen), 2, 2))
    for k in range(len(chosen)):
        row = table[chosen[k]]
        x[k], y[k], flux[k], snr[k] = row[0], row[1], row[2], row[2] / row[3]
        covariance[k, 0, 0], covariance[k, 1, 1] = row[4], row[6]
        covariance[k, 0, 1] = covariance[k, 1, 0] = row[5]
    return x, y, flux, covariance, snr, area[chosen]


@njit(cache=True, error_model="numpy")
def _apart(table: Floats, order: Ints, most: int) -> Ints:
    """Which places in `order` to keep: those with a flux, one for each star, the first `most`."""
    kept = np.empty(min(len(order), most), np.int64)
    count = 0
    for k in range(len(order)):
        x, y, flux = table[order[k], 0], table[order[k], 1], table[order[k], 2]
        if count == len(kept) or np.isnan(flux):
            break
        new = True
        for other in kept[:count]:
            dx, dy = table[order[other], 0] - x, table[order[other], 1] - y
            if dx * dx + dy * dy < SAME * SAME:
                new = False
                break
        if new:
            kept[count] = k
            count += 1
    return kept[:count]
