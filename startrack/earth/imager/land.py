"""Reflectance and temperature of ground: covers by height, maps, texture, slopes, hot spots."""

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from startrack import core
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
)
from startrack.earth.imager import brdf
from startrack.earth.terrain import EQUATORIAL, Ground, cartesian, fractal, up

TEXELS = 1024  # texels along each side of the periodic texture
# spectral exponent of the texture, as for `fractal`: rougher than mountains; chosen by hand
ROUGHNESS = 1.2
GREY = core.Curve((), (0.2,))
BRIGHTEST = 2.0  # reflectance factor of a map: above the sunlit side of clouds
DEPTHS = -1000.0  # metre, below all land


class Cover(Parameters):
    """Reflectance and temperature of ground above a height.

    The cover is Lambertian, or `ross_li`, `water` or `snow`.
    """

    reflectance: core.Curve = parameter(
        "1 over wavelength: reflectance of Lambertian ground; isotropic weight of `ross_li`; "
        "reflectance of the light from below the surface of `water`; white-sky albedo of `snow`. "
        "The emissivity is 1 minus this reflectance, or 1 minus the reflected fraction of a "
        "uniform sky",
        default=GREY,
    )
    temperature: float = parameter(
        "temperature at height zero",
        unit=Unit("K", absolute=True),
        limit=Range(50, 3000),
        default=288.0,
    )
    above: float = parameter("above the ellipsoid", unit=Unit("m"), limit=FINITE, default=DEPTHS)
    ross_li: brdf.RossLi | None = None
    water: brdf.Water | None = None
    snow: brdf.Snow | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if sum(law is not None for law in (self.ross_li, self.water, self.snow)) > 1:
            raise ValueError("only one of ross_li, water and snow must be given, got more")

    @property
    def law(self) -> brdf.Law | None:
        """Law of the reflectance over directions; None: independent of direction."""
        return self.ross_li or self.water or self.snow

    def weights(self, wavelength: Floats, weight: Floats) -> tuple[float, float, float]:
        """Weights of the isotropic, volumetric and geometric kernels in a band."""
        law = self.ross_li or brdf.RossLi()
        isotropic, volumetric, geometric = (
            float(curve(wavelength) @ weight)
            for curve in (self.reflectance, law.volumetric, law.geometric)
        )
        return isotropic, volumetric, geometric


class ReflectanceMap(Parameters):
    """A map of the terrain whose values are reflectance at one wavelength."""

    map: str = parameter("name of the map in `terrain.maps`")
    wavelength: float = parameter(unit=Unit("m", "nm"), limit=POSITIVE)
    factor: float = parameter(
        "1, factor of the values, such as 1e-4 for Sentinel-2", limit=FINITE, default=1.0
    )
    offset: float = parameter("1, then added", limit=FINITE, default=0.0)


class HotSpot(Parameters):
    """A fire: a blackbody, possibly smaller than a pixel."""

    longitude: float = parameter(unit=Unit("rad", "deg"), limit=FINITE)
    latitude: float = parameter(unit=Unit("rad", "deg"), limit=Range(-math.pi / 2, math.pi / 2))
    area: float = parameter("square metre", unit=Unit("m2"), limit=POSITIVE)
    temperature: float = parameter(
        unit=Unit("K", absolute=True), limit=Range(50, 3000), default=1000.0
    )


class Land(Parameters):
    """The surface of a scene."""

    covers: tuple[Cover, ...] = parameter(
        "covers by rising height; a cover ends at the height of the next", default=(Cover(),)
    )
    texture: float = parameter(
        "1, rms of the relative variation of reflectance: a fractal from a seed",
        limit=Range(0, 1),
        default=0.0,
    )
    texture_cell: float = parameter(
        "its smallest detail", unit=Unit("m"), limit=POSITIVE, default=30.0
    )
    texture_seed: int = parameter(limit=Range(0, 2**31), default=1)
    temperature_texture: float = parameter(
        "rms of the variation of temperature: a fractal from the seed after `texture_seed`",
        unit=Unit("K"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    lapse: float = parameter(
        "decrease of temperature with height",
        unit=Unit("K / m", "K / km"),
        limit=FINITE,
        default=6.5e-3,
    )
    warming: float = parameter(
        "temperature of ground that faces the Sun minus temperature of ground in shadow",
        unit=Unit("K"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    hot_spots: tuple[HotSpot, ...] = parameter("fires", default_factory=tuple)
    maps: tuple[ReflectanceMap, ...] = parameter(
        "maps of reflectance, which replace the covers' reflectance where they have values; "
        "linear between their wavelengths, constant beyond",
        default=(),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.covers:
            raise ValueError("covers must have one entry or more, got none")
        heights = [cover.above for cover in self.covers]
        if heights != sorted(heights):
            raise ValueError(f"covers must rise in their heights above, got {heights}")
        lengths = [map_.wavelength for map_ in self.maps]
        if any(b <= a for a, b in pairwise(lengths)):
            raise ValueError(f"maps must rise in their wavelengths, got {lengths}")


def cover_at(land: Land, height: float) -> Cover:
    """The cover of the land at a height, metre."""
    ground = [cover for cover in land.covers if cover.above <= height]
    return ground[-1] if ground else land.covers[0]


def reflectance(land: Land, ground: Ground, wavelength: Floats, weight: Floats) -> Floats:
    """Mean reflectance of n rays in one band, without the dependence on direction.

    wavelength, weight  (f,) metre; (f,) 1, weights of the detected light with the sum one
    Returns             (n,) 1, in [0, 1]; reflectance of the lowest cover for rays that miss
    """
    of_cover = np.array([cover.reflectance(wavelength) @ weight for cover in land.covers])
    here = of_cover[_cover(land, ground)]
    if land.maps:
        mapped = _mapped(land, ground, wavelength, weight)
        here = np.where(np.isnan(mapped), here, mapped)
    if land.texture:
        here = here * (1 + land.texture * _texture(land, ground, land.texture_seed))
    return np.clip(here, 0.0, 1.0)


class Reflection(NamedTuple):
    """Reflectance factors (n,) of rays in one band: for sunlight, for skylight, and the albedo."""

    direct: Floats
    sky: Floats
    albedo: Floats


def reflection(land: Land, ground: Ground, wavelength: Floats, weight: Floats) -> Reflection:
    """Reflection of sunlight and skylight to the camera along n rays.

    wavelength, weight  as for `reflectance`
    Accuracy            model: reflectance is averaged over the band before the law of directions. A
                        surface of waves or snow follows the slope of the terrain.
    """
    rho = reflectance(land, ground, wavelength, weight)
    if not any(cover.law for cover in land.covers):
        return Reflection(rho, rho, rho)
    out = Reflection(*(rho.copy() for _ in range(3)))
    cover, angles = _cover(land, ground), brdf.angles_of(ground)
    for n, kind in enumerate(land.covers):
        mine = np.flatnonzero(ground.hit & (cover == n))
        if kind.law and len(mine):
            seen = brdf.Angles(*(cosines[mine] for cosines in angles))
            weights = kind.weights(wavelength, weight)
            out.direct[mine] = brdf.direct_factor(kind.law, rho[mine], weights, seen)
            out.sky[mine] = brdf.sky_factor(kind.law, rho[mine], weights, seen.camera)
            out.albedo[mine] = brdf.sky_factor(kind.law, rho[mine], weights, None)
    return out


def temperature(land: Land, ground: Ground) -> Floats:
    """Temperature of n rays, (n,) kelvin, without hot spots."""
    of_cover = np.array([cover.temperature for cover in land.covers])
    facing = np.where(ground.shadow, 0.0, np.cos(ground.sun_incidence))
    warm = of_cover[_cover(land, ground)] - land.lapse * ground.height + land.warming * facing
    if land.temperature_texture:
        warm = warm + land.temperature_texture * _texture(land, ground, land.texture_seed + 1)
    return np.where(ground.hit, np.clip(warm, 50, 3000), of_cover[0])


def burning_fraction(spot: HotSpot, ground: Ground, spread: float) -> Floats:
    """Burning fraction of the field of each of n rays.

    The spot is a Gaussian with the spot's area, as wide as the rays or the spot, whichever is
    wider.

    spread   radian between rays
    Returns  (n,) 1, in [0, 1]
    """
    here = np.array(spot.longitude), np.array(spot.latitude)
    normal = up(*here)
    # Distance along the ellipsoid, so that the spot is on the ground at any height.
    aside = ground.point - cartesian(*here, np.array(0.0))
    aside = aside - (aside @ normal)[:, None] * normal
    variance = np.maximum((ground.distance * spread) ** 2, spot.area / (2 * math.pi))
    with np.errstate(invalid="ignore"):
        peaked = np.exp(-0.5 * (aside**2).sum(1) / variance)
        fraction = peaked * spot.area / (2 * math.pi * variance)
    return np.where(ground.hit, np.minimum(fraction, 1.0), 0.0)


def _cover(land: Land, ground: Ground) -> Ints:
    heights = np.array([cover.above for cover in land.covers])
    number = np.searchsorted(heights, np.nan_to_num(ground.height, nan=DEPTHS), side="right") - 1
    return np.maximum(number, 0)


def _mapped(land: Land, ground: Ground, wavelength: Floats, weight: Floats) -> Floats:
    """Reflectance (n,) of maps in a band; NaN where a map has no value."""
    at = [map_.wavelength for map_ in land.maps]
    out = np.zeros(len(ground))
    for n, map_ in enumerate(land.maps):
        if map_.map not in ground.maps:
            names = ", ".join(ground.maps) or "none"
            raise ValueError(f"land.maps must name maps of the terrain, {names}, got {map_.map!r}")
        share = np.interp(wavelength, at, np.eye(len(at))[n]) @ weight
        if share:
            values = ground.maps[map_.map] * map_.factor + map_.offset
            if (highest := float(np.fmax.reduce(values, initial=0.0))) > BRIGHTEST:
                raise Refused(
                    f"land.maps must give reflectance by factor and offset, at most {BRIGHTEST:g}, "
                    f"got {highest:g} of {map_.map!r}"
                )
            out += share * values
    return out


def _texture(land: Land, ground: Ground, seed: int) -> Floats:
    """Deviation (n,) of mean zero and rms one."""
    longitude, latitude = np.nan_to_num(ground.longitude), np.nan_to_num(ground.latitude)
    x, y = on_texture(longitude, latitude, land.texture_cell)
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    return _texels(seed)[j % TEXELS, i % TEXELS]


def on_texture(longitude: Floats, latitude: Floats, cell: float) -> tuple[Floats, Floats]:
    """Places (n,) in texels of a periodic texture on the Earth.

    The projection is sinusoidal: equal areas, no seams, sheared far from Greenwich.

    longitude, latitude  (n,) radian
    cell                 metre, side of a texel
    """
    step = cell / EQUATORIAL
    return longitude * np.cos(latitude) / step, latitude / step


@lru_cache(maxsize=4)
def _texels(seed: int) -> Floats:
    """A fractal rougher than mountains: fields, forests, rocks."""
    values = fractal(TEXELS, TEXELS, core.Streams(seed, 1), 1.0, ROUGHNESS).astype(np.float64)
    return (values - values.mean()) / values.std()
