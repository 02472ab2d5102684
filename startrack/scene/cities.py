"""Earth and date -> the lights of its large cities at night, as points."""

import math
from functools import lru_cache

import numpy as np

from startrack.core import GOLDEN_ANGLE, Floats, deg, nm
from startrack.scene.bodies import Earth
from startrack.scene.ephemeris import SkyObserver
from startrack.scene.photometry import BIN, WAVELENGTH, blackbody_photons
from startrack.space import EARTH_RADIUS, J2000

# Million inhabitants, latitude and longitude in degree: the urban agglomerations of ten million
# and more, and some of the brightest below. Source: United Nations, World Urbanization Prospects
# (2018), rounded.
CITIES = (
    (37.4, 35.7, 139.7), (28.5, 28.6, 77.2), (25.6, 31.2, 121.5), (21.7, -23.5, -46.6),
    (21.6, 19.4, -99.1), (20.1, 30.0, 31.2), (20.0, 19.1, 72.9), (19.6, 39.9, 116.4),
    (19.6, 23.8, 90.4), (19.3, 34.7, 135.5), (18.8, 40.7, -74.0), (15.4, 24.9, 67.0),
    (15.0, -34.6, -58.4), (14.8, 29.6, 106.6), (14.8, 41.0, 29.0), (14.7, 22.6, 88.4),
    (13.5, 14.6, 121.0), (13.5, 6.5, 3.4), (13.3, -22.9, -43.2), (13.2, 39.1, 117.2),
    (13.2, -4.3, 15.3), (12.6, 23.1, 113.3), (12.5, 34.1, -118.2), (12.4, 55.8, 37.6),
    (11.9, 22.5, 114.1), (11.7, 31.6, 74.3), (11.4, 13.0, 77.6), (10.9, 48.9, 2.4),
    (10.6, 4.7, -74.1), (10.5, -6.2, 106.8), (10.5, 13.1, 80.3), (10.4, -12.0, -77.0),
    (10.2, 13.8, 100.5), (10.0, 37.6, 127.0), (9.5, 35.2, 136.9), (9.3, 17.4, 78.5),
    (9.0, 51.5, -0.1), (8.9, 35.7, 51.4), (8.9, 41.9, -87.6), (8.3, 30.6, 104.1),
    (6.8, -33.4, -70.7), (6.5, 40.4, -3.7), (6.5, 24.7, 46.7), (6.1, 43.7, -79.4),
    (6.1, 33.7, -84.4), (5.9, 29.8, -95.4), (4.9, -33.9, 151.2), (4.8, 52.5, 13.4),
    (3.1, 25.2, 55.3), (2.2, 36.2, -115.1),
)  # fmt: skip
# Garstang (1986), PASP 98, 364: 1000 lumen per head; a fraction of 0.15 is emitted upwards, and the
# ground reflects 0.15 of the rest.
UPWARDS = 1000 * (0.15 + 0.15 * 0.85)  # lumen a head
LUX_OF_ZERO = 2.54e-6  # of a star of V = 0
PHOTONS_OF_ZERO = 1.0e8  # photon / s / m^2 / nm at 550 nm, of the same
LAMP = 2700.0  # kelvin, warm white; chosen by hand
DENSITY = 4000.0  # heads / km^2; chosen by hand: sets the size of a city
HEADS_PER_POINT = 0.5e6  # chosen by hand: shape of a city against the number of points
DUSK = -6 * deg  # elevation of the Sun at the end of civil twilight, when lamps are lit


def cities(earth: Earth, observer: SkyObserver) -> tuple[Floats, Floats]:
    """The cities that are lit and visible.

        V = -2.5 log10(lumen cos(a) / pi / distance^2 / 2.54e-6 lux),  a from the zenith

    Returns  (n, 3) unit vectors, ICRS axes, and (n, k) photon / s / m^2 in each bin
    Accuracy  model: a factor of three for a city, which is a uniform disc; towns below two million
              are left out; no atmosphere, no clouds. Positions within 0.2 degree: precession and
              nutation since 2000 are left out.
    """
    point, heads = _city_points()
    zenith = point @ _earth_to_icrs(observer.day).T
    line = EARTH_RADIUS * zenith + earth.centre
    distance = np.linalg.norm(line, axis=1)
    direction = line / distance[:, None]
    cosine = -np.einsum("ij,ij->i", direction, zenith)
    lit = (cosine > 0) & (zenith @ earth.sun < math.sin(DUSK))
    lux = heads * UPWARDS / math.pi * np.maximum(cosine, 0) / distance**2
    lamp = blackbody_photons(WAVELENGTH, np.array([LAMP]))[0]
    at_550 = blackbody_photons(np.array([550 * nm]), np.array([LAMP]))[0, 0]
    rate = np.outer(lux / LUX_OF_ZERO, PHOTONS_OF_ZERO * BIN / nm * lamp / at_550)
    return direction[lit], rate[lit]


def _earth_to_icrs(day: float) -> Floats:
    """(3, 3) from axes fixed to the Earth to ICRS axes, by the Earth rotation angle.

    Source: IAU 2000, resolution B1.8; 69 s of TDB - UT1 as in 2026.
    """
    angle = 2 * math.pi * (0.7790572732640 + 1.00273781191135448 * (day - 69 / 86400 - J2000))
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


@lru_cache(maxsize=1)
def _city_points() -> tuple[Floats, Floats]:
    """(n, 3) unit vectors in axes fixed to the Earth, (n,) inhabitants of each point."""
    points, heads = [], []
    for million, latitude, longitude in CITIES:
        count = math.ceil(million * 1e6 / HEADS_PER_POINT)
        radius = math.sqrt(million * 1e6 / DENSITY / math.pi) * 1e3 / EARTH_RADIUS
        k = np.arange(count)
        out, turn = radius * np.sqrt((k + 0.5) / count), k * GOLDEN_ANGLE
        north = latitude * deg + out * np.cos(turn)
        east = longitude * deg + out * np.sin(turn) / math.cos(latitude * deg)
        flat = np.cos(north)
        points.append(np.stack([flat * np.cos(east), flat * np.sin(east), np.sin(north)], -1))
        heads.append(np.full(count, million * 1e6 / count))
    return np.concatenate(points), np.concatenate(heads)
