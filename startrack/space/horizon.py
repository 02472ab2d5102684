"""A place on the Earth -> its horizon, and refraction of stars by the air above it."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from startrack.core import Floats, deg
from startrack.space.earth import EARTH_RADIUS

# U.S. Standard Atmosphere 1976: metre of geopotential, and kelvin a metre from there on.
LAYERS = ((0.0, -6.5e-3), (11e3, 0.0), (20e3, 1e-3), (32e3, 2.8e-3), (47e3, 0.0), (51e3, -2.8e-3))
ENDS = (*(start for start, _ in LAYERS[1:]), math.inf)
GROUND = 288.15  # kelvin
GRAVITY_OVER_GAS = 9.80665 * 28.9644e-3 / 8.31432  # kelvin a metre
REFRACTIVITY = 2.778e-4  # of that air at the ground: Ciddor (1996), dry, 550 nm
TOP, SHELLS = 71e3, 4000  # metre; between there and the camera
# Radian: elevations at which stars are seen, nearer to each other at the horizon.
SEEN: Floats = np.concatenate([np.linspace(0, 3, 61), np.linspace(3.25, 90, 348)]) * deg


def horizon_axes(latitude: float, longitude: float) -> Floats:
    """Columns east, north and up (3, 3) in the Earth's axes."""
    (s, c), (sl, cl) = ((math.sin(x), math.cos(x)) for x in (latitude, longitude))
    return np.array([[-sl, -s * cl, c * cl], [cl, -s * sl, c * sl], [0.0, c, s]])


def refraction(elevation: Floats, height: float, *, seen: bool = False) -> Floats:
    """Refraction of stars by the air above a height, radian.

    Snell's law through spherical shells of the U.S. Standard Atmosphere 1976.

    elevation  radian, without air; below that of a star which is seen at the horizon, as there
    height     metre above the sea, -500 to 40,000
    seen       whether the elevation is the one at which the star is seen
    Accuracy   model: dry air of 15 degC and 1013 hPa at the sea, 550 nm; 15 K or 50 hPa change it
               by 5 %, at the horizon by more. numerical: 0.01 arcsec above 10 degrees.
    """
    lift = _lift(height)
    return np.asarray(np.interp(elevation, SEEN if seen else SEEN - lift, lift))


@lru_cache(maxsize=16)
def _lift(height: float) -> Floats:
    """Radian, at the elevations SEEN."""
    edges = np.linspace(height, TOP, SHELLS + 1)
    index = 1 + REFRACTIVITY * _density((edges[:-1] + edges[1:]) / 2)
    index[0] = 1 + REFRACTIVITY * _density(edges[:1])[0]  # that of the camera
    index = np.append(index, 1.0)
    radius = EARTH_RADIUS + edges[1:]
    # n r cos(elevation) stays along a ray; angles are from the vertical.
    kept = (index[0] * (EARTH_RADIUS + height) * np.cos(SEEN))[:, None]
    below = np.arcsin(np.minimum(kept / (index[:-1] * radius), 1.0))
    above = np.arcsin(np.minimum(kept / (index[1:] * radius), 1.0))
    return np.asarray((above - below).sum(axis=1))


def standard_temperature(height: float) -> float:
    """Temperature of the U.S. Standard Atmosphere 1976, kelvin.

    height   metre of geopotential; below the sea and above 51 km as in the next layer
    """
    temperature = GROUND
    for (start, lapse), end in zip(LAYERS, ENDS, strict=True):
        temperature += lapse * (min(height, end) - start)
        if height <= end:
            break
    return temperature


def _density(height: Floats) -> Floats:
    """Density of the standard atmosphere over that at sea level; heights are geopotential."""
    temperature, pressure = GROUND, 1.0
    density = np.empty_like(height)
    for (start, lapse), end in zip(LAYERS, ENDS, strict=True):
        here = (height < end) & ((height >= start) | (start == 0))
        rise = height[here] - start
        warmer = (temperature + lapse * rise) / GROUND
        density[here] = pressure * _pressure(lapse, temperature, rise) / warmer
        if math.isfinite(end):
            pressure *= float(_pressure(lapse, temperature, np.array(end - start)))
            temperature += lapse * (end - start)
    return density


def _pressure(lapse: float, temperature: float, rise: Floats) -> Floats:
    """Over that at the foot of a layer, which has the temperature."""
    if lapse == 0:
        return np.asarray(np.exp(-GRAVITY_OVER_GAS * rise / temperature))
    return np.asarray((1 + lapse * rise / temperature) ** (-GRAVITY_OVER_GAS / lapse))
