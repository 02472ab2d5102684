"""Spots and the believed camera enter; the spots in its image plane leave, for compiled code."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from startrack.camera import Camera
from startrack.identification.parameters import Identification
from startrack.values import Floats, Ints, Spots

GATE = 3.0  # sigma of the centroids: the match radius is not smaller
LEAST_SIGMA = 0.01  # pixel, that a centroid is believed
PER_SNR = 2.5 / math.log(10)  # magnitude, error of a flux of signal-to-noise ratio one


class Seen(NamedTuple):
    """Spots as the believed camera sees them.

    plane      (n, 2) x / z and y / z
    direction  (n, 3) unit vectors, camera axes
    sigma      (n,) radian, of the centroids along each axis
    magnitude  (n,) -2.5 lg flux; NaN where there is none
    blur       (n,) magnitude, its standard deviation
    low, high  (2,) x / z and y / z of the corners of the image
    corner     radian, from the boresight to the farthest corner
    radius     1, match radius in the plane
    excess     1, the same as far as it is not due to noise
    area       1, of the image in the plane
    focal      relative, tolerance of the focal length
    """

    plane: Floats
    direction: Floats
    sigma: Floats
    magnitude: Floats
    blur: Floats
    low: Floats
    high: Floats
    corner: float
    radius: float
    excess: float
    area: float
    focal: float


def usable(spots: Spots) -> Ints:
    """Which spots are at a finite place."""
    return np.flatnonzero(np.isfinite(spots.x + spots.y))


def see(spots: Spots, chosen: Ints, camera: Camera, settings: Identification) -> Seen:
    """The chosen spots in the image plane of the believed camera."""
    pixel = np.column_stack([spots.x[chosen], spots.y[chosen]])
    focal = camera.focal_length_px
    # The border of the undistorted image; distortion moves it by a few pixels, no matter here.
    centre = np.array(camera.centre)
    low = (-0.5 - centre) / focal
    high = (np.array([camera.columns, camera.rows]) - 0.5 - centre) / focal
    plane = (pixel - centre) / focal
    if camera.distorted:
        direction = camera.unproject(pixel)
        plane = direction[:, :2] / direction[:, 2:]
    voting = settings.verify_spots
    return _see(
        plane,
        spots.covariance[chosen],
        spots.flux[chosen].astype(np.float64),
        spots.snr[chosen].astype(np.float64),
        low,
        high,
        focal,
        settings.match_radius,
        settings.focal_tolerance,
        voting,
    )


@njit(cache=True, error_model="numpy")
def _see(
    plane: Floats,
    covariance: Floats,
    flux: Floats,
    snr: Floats,
    low: Floats,
    high: Floats,
    focal: float,
    match_radius: float,
    tolerance: float,
    voting: int,
) -> Seen:  # pragma: no cover
    n = len(plane)
    direction = np.empty((n, 3))
    sigma, magnitude, blur = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        x, y = plane[i]
        z = 1 / math.sqrt(1 + x * x + y * y)
        direction[i] = x * z, y * z, z
        pixel = math.sqrt(max((covariance[i, 0, 0] + covariance[i, 1, 1]) / 2, 0.0))
        if not math.isfinite(pixel):
            pixel = match_radius
        sigma[i] = min(max(pixel, LEAST_SIGMA), match_radius)
        magnitude[i] = -2.5 * math.log10(flux[i]) if 0 < flux[i] < np.inf else np.nan
        blur[i] = PER_SNR / snr[i] if snr[i] > 0 else np.inf
    radius = max(match_radius, GATE * float(np.median(sigma[:voting]))) if n else match_radius
    x, y = max(-low[0], high[0]), max(-low[1], high[1])
    return Seen(
        plane,
        direction,
        sigma / focal,
        magnitude,
        blur,
        low,
        high,
        math.atan(math.hypot(x, y)),
        radius / focal,
        match_radius / focal,
        (high[0] - low[0]) * (high[1] - low[1]),
        tolerance,
    )


@njit(cache=True, error_model="numpy")
def first(seen: Seen, count: int) -> Seen:  # pragma: no cover
    """The same with the first so many spots alone."""
    return Seen(
        seen.plane[:count],
        seen.direction[:count],
        seen.sigma[:count],
        seen.magnitude[:count],
        seen.blur[:count],
        seen.low,
        seen.high,
        seen.corner,
        seen.radius,
        seen.excess,
        seen.area,
        seen.focal,
    )
