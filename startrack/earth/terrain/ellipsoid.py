"""Cartesian and geodetic coordinates on the ellipsoid WGS84, and back."""

import math

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from startrack.core import Floats, kernel
from startrack.space import EARTH_RADIUS as EQUATORIAL
from startrack.space import FLATTENING
from startrack.space import POLAR_RADIUS as POLAR
from startrack.space import SQUARED_ECCENTRICITY as ECCENTRICITY_2

SECOND_ECCENTRICITY_2 = ECCENTRICITY_2 / (1 - ECCENTRICITY_2)


def cartesian(longitude: Floats, latitude: Floats, height: Floats) -> Floats:
    """Earth-fixed point of geodetic coordinates.

        P = [(N + h) cos(lat) cos(lon), (N + h) cos(lat) sin(lon), (N (1 - e^2) + h) sin(lat)]

    longitude, latitude  (...) radian
    height               (...) metre above the ellipsoid
    Returns              (..., 3) metre
    """
    sine = np.sin(latitude)
    normal = EQUATORIAL / np.sqrt(1 - ECCENTRICITY_2 * sine**2)
    across = (normal + height) * np.cos(latitude)
    along = (normal * (1 - ECCENTRICITY_2) + height) * sine
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), along], axis=-1)


def geodetic(point: Floats) -> tuple[Floats, Floats, Floats]:
    """Longitude, latitude and height of Earth-fixed points.

    Source: Bowring (1985), Survey Review 28, 202, with one more step.

    point    (..., 3) metre
    Returns  longitude in (-pi, pi] and latitude, (...) radian; height, (...) metre
    Accuracy  numerical: 5e-9 m from -5 to 1000 km of height, 3e-8 m at 36000 km; not valid within
              100 km of the centre of the Earth.
    """
    point = np.ascontiguousarray(point, float)
    out = _geodetic_all(point.reshape(-1, 3))
    longitude, latitude, height = (out[:, i].reshape(point.shape[:-1]) for i in range(3))
    return longitude, latitude, height


def up(longitude: Floats, latitude: Floats) -> Floats:
    """Unit vectors (..., 3) normal to the ellipsoid, at (...) radian."""
    across = np.cos(latitude)
    return np.stack(
        [across * np.cos(longitude), across * np.sin(longitude), np.sin(latitude)], axis=-1
    )


@kernel
def _geodetic_all(point):  # type: ignore[no-untyped-def]
    out = np.empty((len(point), 3))
    for n in range(len(point)):
        x, y, z = point[n]
        sine, cosine, height, _ = vertical(x, y, z)
        out[n, 0] = math.atan2(y, x)
        out[n, 1] = math.atan2(sine, cosine)
        out[n, 2] = height
    return out


# The functions below that are inlined by force have no branches, so that loops over rays are
# vectorised.
@kernel(forceinline=True)
def vertical(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Sine and cosine of the latitude, height, and distance from the axis of one point.

    It calls no trigonometric function: latitude and reduced latitude are kept as sine and cosine.
    """
    across = math.sqrt(x * x + y * y)
    radius = math.sqrt(across * across + z * z)
    sine = POLAR * z * (1 + SECOND_ECCENTRICITY_2 * POLAR / radius)
    cosine = EQUATORIAL * across
    for _ in range(2):
        scale = 1 / math.sqrt(sine * sine + cosine * cosine)
        sine, cosine = sine * scale, cosine * scale
        rise = z + SECOND_ECCENTRICITY_2 * POLAR * sine * sine * sine
        run = across - ECCENTRICITY_2 * EQUATORIAL * cosine * cosine * cosine
        sine, cosine = (1 - FLATTENING) * rise, run
    scale = 1 / math.sqrt(rise * rise + run * run)
    sine, cosine = rise * scale, run * scale
    level = EQUATORIAL * math.sqrt(1 - ECCENTRICITY_2 * sine * sine)
    return sine, cosine, across * cosine + z * sine - level, across


# (atan(t) / t - 1) / t^2 = -1/3 + t^2 / 5 - t^4 / 7 ... up to tan(pi / 8), in fewer terms.
ARC = tuple(
    Chebyshev.interpolate(
        lambda q: np.sum([(-1) ** k * q ** (k - 1) / (2 * k + 1) for k in range(1, 50)], axis=0),
        10,
        [0, 0.1716],
    )
    .convert(kind=Polynomial)
    .coef.tolist()
)


@kernel(forceinline=True)
def angle(y, x):  # type: ignore[no-untyped-def]
    """Like atan2, to 3e-16 radian."""
    tall, wide = abs(y), abs(x)
    low, high = (tall, wide) if tall < wide else (wide, tall)
    half = low > 0.4142135623730950 * high
    t = (low - high if half else low) / (low + high if half else high)
    q = t * t
    series = ARC[10]
    for k in range(9, -1, -1):
        series = series * q + ARC[k]
    turn = t + t * q * series
    turn = turn + 0.25 * math.pi if half else turn
    turn = 0.5 * math.pi - turn if tall > wide else turn
    turn = math.pi - turn if x < 0 else turn
    return -turn if y < 0 else turn


@kernel(forceinline=True)
def shell(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, height: float
) -> tuple[float, float]:
    """Distances at which a ray enters and leaves the ellipsoid with axes longer by `height`.

    That ellipsoid deviates from the surface of constant height by 2 cm up to 9 km, by 14 cm at 100
    km. The ray misses if the first distance is the larger.
    """
    wide, tall = 1 / (EQUATORIAL + height), 1 / (POLAR + height)
    ox, oy, oz = ox * wide, oy * wide, oz * tall
    dx, dy, dz = dx * wide, dy * wide, dz * tall
    a = dx * dx + dy * dy + dz * dz
    b = ox * dx + oy * dy + oz * dz
    # The square of the distance from the centre; b^2 - a c would lose digits.
    cx, cy, cz = oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx
    rest = a - (cx * cx + cy * cy + cz * cz)
    root = math.sqrt(rest) if rest >= 0 else -math.inf
    fraction = 1 / a
    return (-b - root) * fraction, (root - b) * fraction
