"""DaySky with the Sun below the horizontal -> sunlight that the air scatters."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np

from startrack.core import Floats
from startrack.io import checked_arrays, shipped
from startrack.scene.air_above import (
    AIR_SCALE,
    EARTH,
    OZONE_FROM,
    OZONE_TO,
    WATER_SCALE,
    LitRay,
    SkyTable,
    between,
    gas_transmittance,
    place_in,
    scattered_more,
    sources_of_ray,
    to_bins,
)
from startrack.scene.day_sky import DaySky, SunPlace

FORMAT = 1  # of the file


@dataclass(frozen=True, eq=False)
class DuskTable:
    """Light that reaches a camera from above while the Sun is at or below the horizontal.

    The air and the other axes are those of `SkyTable`, without aerosol and with ozone between
    OZONE_FROM and OZONE_TO.

    sun       (d,) radian, zenith angle of the Sun
    multiple  (k, h, v, d, p) 1 / sr, multiply scattered light over black ground
    ground    (k, h, v, d) 1 / sr, additional light per unit of albedo
    ozone     (k,) 1 / metre, extinction
    """

    sun: Floats
    multiple: Floats
    ground: Floats
    ozone: Floats


ARRAYS = tuple(part.name for part in fields(DuskTable))


def dusk_light(table: SkyTable, sky: DaySky, sun: SunPlace) -> Floats:
    """(bins,) 1 / sr, light scattered by the air, over the irradiance of a Sun below the horizon.

    Light scattered once is summed along the line of sight, with the Earth's shadow. Multiply
    scattered light is interpolated in a table. For a Sun below the table it is extrapolated in the
    logarithm, from the last two zenith angles.

    Source    sasktran2 (Zawada et al.), by successive orders; catalogs/atmosphere
    Accuracy  model: straight rays, without the refraction that lifts the Sun by half a degree at
              the horizon. Against fits of the zenith of Paranal with the Sun 5 to 10 degrees below
              the horizon, with an aerosol of 0.3: V within 0.3 mag, B, R and I within 0.6. With an
              aerosol of 0 or 1.0, R and I are wrong by up to 0.9 mag. numerical: see
              `catalogs/atmosphere/air_solver.py`.
    """
    dusk = _table()
    inside = (table.level >= OZONE_FROM) & (table.level <= OZONE_TO)
    ray = sources_of_ray(table, sky, sun, dusk.ozone[:, None] * inside)
    light = ray.light.sum(1) / (4 * math.pi) + _scattered_more(table, dusk, sky, sun)
    water, mixed = (_air_mass(table, ray, scale) for scale in (WATER_SCALE, AIR_SCALE))
    return to_bins(table, light) * gas_transmittance(table, np.array([water, mixed, 0.0]))


def _scattered_more(table: SkyTable, dusk: DuskTable, sky: DaySky, sun: SunPlace) -> Floats:
    """(k,) 1 / sr, multiply scattered light, and light of the ground.

    The effect of the aerosol is that for a Sun at the horizontal.
    """
    axes, place = place_in(table, dusk.sun, sky, sun)
    second_last, last = float(dusk.sun[-2]), float(dusk.sun[-1])

    def light(zenith: float) -> Floats:
        at = [*place[:2], zenith, place[3]]
        ground = between(axes[:3], dusk.ground, at[:3])
        return between(axes, dusk.multiple, at) + sky.albedo * ground

    clear = replace(sky, aerosol=0.0)
    haze = sum(scattered_more(table, sky, sun)) / sum(scattered_more(table, clear, sun))
    in_table, beyond = light(place[2]), math.pi / 2 - sun.elevation - last
    if beyond <= 0:
        return haze * in_table
    return haze * in_table * (in_table / light(second_last)) ** (beyond / (last - second_last))


def _air_mass(table: SkyTable, ray: LitRay, scale: float) -> float:
    """Air masses of a gas on the way of light from the Sun over a step of the ray to the camera.

    It is the mean over the steps, weighted by the light that they scatter.

    scale  metre, scale height of the gas
    """
    height = (table.level[1:] + table.level[:-1]) / 2
    to_sun = ray.to_sun(table, np.exp(-height / scale)[None] / scale)[0]
    density = np.exp(-(ray.radius - EARTH) / scale) / scale
    weight = ray.light.sum(0)
    crossed = np.cumsum(density * ray.step) + np.where(weight > 0, to_sun, 0)
    if not weight.any():
        return float(crossed[-1])
    return float(np.average(crossed, weights=weight))


@lru_cache(maxsize=1)
def _table() -> DuskTable:
    path = shipped("atmosphere/dusk.fits")
    return DuskTable(*checked_arrays(path, "DUSK", FORMAT, "a table of twilight", ARRAYS))
