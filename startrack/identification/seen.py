"""Spots in the image plane of the believed camera, and the stars expected in the image."""

import math
from typing import NamedTuple

import numpy as np

from startrack.core import Camera, Floats, Ints, Spots, kernel, median, rotated
from startrack.identification.grids import SkyGrid, cubes_around, most_within
from startrack.identification.parameters import Identification

# Chosen by hand: a larger gate matches more false spots, a smaller one loses noisy stars.
GATE = 3.0  # sigma of the centroids, least match radius
# Chosen by hand: with an imperfect camera model, a smaller one gives bright spots too much weight.
LEAST_SIGMA = 0.01  # pixel, smallest standard deviation assumed of a centroid
PER_SNR = 2.5 / math.log(10)  # magnitude, error of a flux of signal-to-noise ratio one


class Seen(NamedTuple):
    """Spots as the believed camera sees them.

    plane      (n, 2) x / z and y / z
    direction  (n, 3) unit vectors, camera axes
    sigma      (n,) radian, standard deviation of the centroids along each axis
    magnitude  (n,) -2.5 lg flux; NaN if there is no flux
    blur       (n,) magnitude, standard deviation of `magnitude`
    low, high  (2,) x / z and y / z of the corners of the image
    corner     radian, from the boresight to the farthest corner
    radius     1, match radius in the image plane
    excess     1, match radius without the part for noise: `match_radius` of the settings
    area       1, of the image in the image plane
    focal      1, relative tolerance of the focal length
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


Border = tuple[float, float, float, float]  # left, top, right, bottom in the image plane


def usable(spots: Spots) -> Ints:
    """Indices of the spots with a finite position."""
    return np.flatnonzero(np.isfinite(spots.x + spots.y))


def see(spots: Spots, chosen: Ints, camera: Camera, settings: Identification) -> Seen:
    """The chosen spots in the image plane of the believed camera."""
    focal, (x, y) = camera.focal_length_px, camera.centre
    if camera.distorted:
        direction = camera.unproject(np.column_stack([spots.x[chosen], spots.y[chosen]]))
        plane, border = direction[:, :2] / direction[:, 2:], _border(camera)
    else:
        plane = np.empty((len(chosen), 2))
        plane[:, 0], plane[:, 1] = spots.x[chosen], spots.y[chosen]
        plane -= x, y
        plane /= focal
        left, top = (-0.5 - x) / focal, (-0.5 - y) / focal
        border = left, top, (camera.columns - 0.5 - x) / focal, (camera.rows - 0.5 - y) / focal
    flux, snr = np.asarray(spots.flux, np.float64), np.asarray(spots.snr, np.float64)
    accuracy = settings.match_radius, settings.focal_tolerance, settings.verify_spots
    return _see(plane, chosen, spots.covariance, flux, snr, border, focal, *accuracy)


def _border(camera: Camera) -> Border:
    """Border of a distorted image in the image plane, from 16 places along each edge."""
    share = np.linspace(0, 1, 16)
    x, y = share * camera.columns - 0.5, share * camera.rows - 0.5
    edges = [np.column_stack([x, 0 * x + end]) for end in (y[0], y[-1])]
    edges += [np.column_stack([0 * y + end, y]) for end in (x[0], x[-1])]
    direction = camera.unproject(np.concatenate(edges))
    plane = direction[:, :2] / direction[:, 2:]
    (left, top), (right, bottom) = plane.min(axis=0).tolist(), plane.max(axis=0).tolist()
    return left, top, right, bottom


@kernel
def _see(
    plane: Floats,
    chosen: Ints,
    covariance: Floats,
    flux: Floats,
    snr: Floats,
    border: Border,
    focal: float,
    match_radius: float,
    tolerance: float,
    voting: int,
) -> Seen:
    """`see` for chosen spots in the image plane; the first `voting` spots determine the radius."""
    n = len(chosen)
    left, top, right, bottom = border
    direction = np.empty((n, 3))
    sigma, magnitude, blur = np.empty(n), np.empty(n), np.empty(n)
    low, high = np.empty(2), np.empty(2)
    low[0], low[1] = left, top
    high[0], high[1] = right, bottom
    for i in range(n):
        x, y, spot = plane[i, 0], plane[i, 1], chosen[i]
        z = 1 / math.sqrt(1 + x**2 + y**2)
        direction[i, 0], direction[i, 1], direction[i, 2] = x * z, y * z, z
        pixel = math.sqrt(max((covariance[spot, 0, 0] + covariance[spot, 1, 1]) / 2, 0.0))
        if not math.isfinite(pixel):
            pixel = match_radius
        sigma[i] = min(max(pixel, LEAST_SIGMA), match_radius)
        magnitude[i] = -2.5 * math.log10(flux[spot]) if 0 < flux[spot] < np.inf else np.nan
        blur[i] = PER_SNR / snr[spot] if snr[spot] > 0 else np.inf
    radius = max(match_radius, GATE * median(sigma[:voting])) if n else match_radius
    return Seen(
        plane,
        direction,
        sigma / focal,
        magnitude,
        blur,
        low,
        high,
        math.atan(math.hypot(max(-left, right), max(-top, bottom))),
        radius / focal,
        match_radius / focal,
        (right - left) * (bottom - top),
        tolerance,
    )


@kernel
def keep_brightest(seen: Seen, count: int) -> Seen:
    """Only the first `count` spots."""
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


@kernel
def with_focal(seen: Seen, focal: float) -> Seen:
    """The same spots with another relative tolerance of the focal length."""
    return Seen(
        seen.plane,
        seen.direction,
        seen.sigma,
        seen.magnitude,
        seen.blur,
        seen.low,
        seen.high,
        seen.corner,
        seen.radius,
        seen.excess,
        seen.area,
        focal,
    )


@kernel
def predict(seen: Seen, sky: SkyGrid, rotation: Floats, scale: float) -> tuple[Ints, Floats]:
    """Indices into `sky` (m,) and positions in the image plane (m, 2) of the stars in the image.

    rotation  (3, 3) icrs_to_camera
    scale     true over believed focal length
    """
    rxx, rxy, rxz = rotation[0]
    ryx, ryy, ryz = rotation[1]
    rzx, rzy, rzz = rotation[2]
    field_radius = min(1.02 * seen.corner / min(scale, 1.0), 1.57)
    nearest = math.cos(field_radius)
    low, high = cubes_around(sky, rotation[2], field_radius)
    left, top = seen.low
    right, bottom = seen.high
    star = np.empty(most_within(sky, low, high) + 1, np.int64)
    place = np.empty((len(star), 2))
    count = 0
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            # Cubes along the last axis are contiguous, and so are their stars.
            row = (i * sky.side + j) * sky.side
            for s in range(sky.start[row + low[2]], sky.start[row + high[2] + 1]):
                dx, dy, dz = sky.direction[s, 0], sky.direction[s, 1], sky.direction[s, 2]
                z = rzx * dx + rzy * dy + rzz * dz
                x = scale * (rxx * dx + rxy * dy + rxz * dz) / z
                y = scale * (ryx * dx + ryy * dy + ryz * dz) / z
                star[count] = s
                place[count, 0], place[count, 1] = x, y
                # No branch: half would be mispredicted, which takes three times as long.
                count += (z > nearest) & (left <= x) & (x <= right) & (top <= y) & (y <= bottom)
    return star[:count], place[:count]


@kernel
def project(direction: Floats, star: Ints, rotation: Floats, scale: float) -> Floats:
    """Positions (m, 2) of the chosen stars in the image plane."""
    place = np.empty((len(star), 2))
    for i in range(len(star)):
        x, y, z = rotated(rotation, direction[star[i]])
        place[i, 0], place[i, 1] = scale * x / z, scale * y / z
    return place
