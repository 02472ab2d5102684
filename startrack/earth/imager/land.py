"""Reflectance and temperature of ground: covers by height, texture, slopes, hot spots."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from startrack.core import (
    Curve,
    Floats,
    Streams,
    Unit,
    finite,
    non_negative,
    positive,
    whole,
    within,
)
from startrack.earth.terrain import EQUATORIAL, Ground, cartesian, fractal, up

TEXELS = 1024  # along each side of the texture, which is periodic
GREY = Curve((), (0.2,))
DEPTHS = -1000.0  # metre, below all land


@dataclass(frozen=True)
class Cover:
    """Reflectance and temperature of ground above a height.

    above        metre above the ellipsoid
    reflectance  1 over wavelength, Lambertian; the emissivity is 1 minus it
    temperature  kelvin, at the height zero
    """

    reflectance: Curve = GREY
    temperature: Annotated[float, Unit("K", absolute=True)] = 288.0
    above: Annotated[float, Unit("m")] = DEPTHS

    def __post_init__(self) -> None:
        within(50, 3000, temperature=self.temperature)
        finite(above=self.above)


@dataclass(frozen=True)
class HotSpot:
    """A fire, a blackbody that may be smaller than a pixel.

    area  square metre
    """

    longitude: Annotated[float, Unit("rad", "deg")]
    latitude: Annotated[float, Unit("rad", "deg")]
    area: Annotated[float, Unit("m2")]
    temperature: Annotated[float, Unit("K", absolute=True)] = 1000.0

    def __post_init__(self) -> None:
        finite(longitude=self.longitude)
        within(-math.pi / 2, math.pi / 2, latitude=self.latitude)
        positive(area=self.area)
        within(50, 3000, temperature=self.temperature)


@dataclass(frozen=True)
class Land:
    """The surface of a scene.

    covers        in the order of their heights; each holds up to the next
    texture       1, rms of the relative variation of reflectance, a fractal from a seed
    texture_cell  metre, its smallest detail
    lapse         kelvin / metre, decrease of temperature with height
    warming       kelvin, ground that faces the Sun minus ground in shadow
    hot_spots     fires
    """

    covers: tuple[Cover, ...] = (Cover(),)
    texture: float = 0.0
    texture_cell: Annotated[float, Unit("m")] = 30.0
    texture_seed: int = 1
    lapse: Annotated[float, Unit("K / m", "K / km")] = 6.5e-3
    warming: Annotated[float, Unit("K")] = 0.0
    hot_spots: tuple[HotSpot, ...] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        if not self.covers:
            raise ValueError("covers must be one or more, got none")
        heights = [cover.above for cover in self.covers]
        if heights != sorted(heights):
            raise ValueError(f"covers must rise in their heights above, got {heights}")
        within(0, 1, texture=self.texture)
        positive(texture_cell=self.texture_cell)
        whole(0, 2**31, texture_seed=self.texture_seed)
        non_negative(warming=self.warming)
        finite(lapse=self.lapse)


def reflectance(land: Land, ground: Ground, wavelength: Floats, weight: Floats) -> Floats:
    """Mean reflectance of n rays in one band.

    wavelength, weight  (f,) metre; (f,) 1, of the detected light; they sum to one
    Returns             (n,) 1, in [0, 1]; that of the lowest cover where a ray misses
    """
    of_cover = np.array([cover.reflectance(wavelength) @ weight for cover in land.covers])
    here = of_cover[_cover(land, ground)]
    if land.texture:
        here = here * (1 + land.texture * _texture(land, ground))
    return np.clip(here, 0.0, 1.0)


def temperature(land: Land, ground: Ground) -> Floats:
    """Temperature of n rays, (n,) kelvin, without hot spots."""
    of_cover = np.array([cover.temperature for cover in land.covers])
    facing = np.where(ground.shadow, 0.0, np.cos(ground.sun_incidence))
    warm = of_cover[_cover(land, ground)] - land.lapse * ground.height + land.warming * facing
    return np.where(ground.hit, np.clip(warm, 50, 3000), of_cover[0])


def burning_fraction(spot: HotSpot, ground: Ground, spread: float) -> Floats:
    """Fraction of the field of each of n rays that burns.

    A Gaussian of the width of the rays, or of the spot where that is wider, with the spot's area.

    spread   radian between rays
    Returns  (n,) 1, in [0, 1]
    """
    here = np.array(spot.longitude), np.array(spot.latitude)
    normal = up(*here)
    # Along the ellipsoid, so that the spot is on the ground at any height.
    aside = ground.point - cartesian(*here, np.array(0.0))
    aside = aside - (aside @ normal)[:, None] * normal
    variance = np.maximum((ground.distance * spread) ** 2, spot.area / (2 * math.pi))
    with np.errstate(invalid="ignore"):
        fraction = (
            np.exp(-0.5 * (aside**2).sum(1) / variance) * spot.area / (2 * math.pi * variance)
        )
    return np.where(ground.hit, np.minimum(fraction, 1.0), 0.0)


def _cover(land: Land, ground: Ground) -> NDArray[np.int64]:
    heights = np.array([cover.above for cover in land.covers])
    found = np.searchsorted(heights, np.nan_to_num(ground.height, nan=DEPTHS), side="right") - 1
    return np.maximum(found, 0)


def _texture(land: Land, ground: Ground) -> Floats:
    """(n,) deviation of mean zero and rms one."""
    step = land.texture_cell / EQUATORIAL
    # Sinusoidal projection: equal areas, no seams, sheared far from Greenwich.
    v = np.nan_to_num(ground.latitude)
    u = np.nan_to_num(ground.longitude) * np.cos(v)
    texels = _texels(land.texture_seed)
    i, j = np.floor(u / step).astype(np.int64), np.floor(v / step).astype(np.int64)
    return texels[j % TEXELS, i % TEXELS]


@lru_cache(maxsize=4)
def _texels(seed: int) -> Floats:
    """A fractal rougher than mountains: fields, forests, rocks; roughness chosen by hand."""
    values = fractal(TEXELS, TEXELS, Streams(seed, 1), 1.0, 1.2).astype(np.float64)
    return (values - values.mean()) / values.std()
