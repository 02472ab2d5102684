"""Reflectance or temperature of the ground from radiance at the sensor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, um
from startrack.earth.atmosphere import at_sensor
from startrack.earth.imager import INFRARED, Band, Setting
from startrack.earth.terrain import Ground

ROUNDS = 6  # of the mean reflectance of the surroundings; each changes it by a tenth of the last
FIRST = 0.2  # guess of it
THINNED = 2**14  # pixels at most that give it


class Retrieval(NamedTuple):
    """What radiance says about the ground, (n,) each or None; NaN for the sky.

    reflectance  1, at the top of the atmosphere
    surface      1, of a Lambertian surface below the air that gives this radiance
    temperature  kelvin, of a blackbody without air that gives this radiance
    """

    reflectance: Floats | None
    surface: Floats | None
    temperature: Floats | None


def is_thermal(band: Band) -> bool:
    """Whether thermal radiance exceeds sunlight: its product is a temperature."""
    return float(band.weight @ band.wavelength) > INFRARED


def retrieve(radiance: Floats, ground: Ground, setting: Setting) -> Retrieval:
    """The products of n pixels.

    radiance  (n,) watt / m^2 / sr / um
    ground    that their middles see
    setting   with the mean reflectance of the ground around, as `surroundings`
    """
    if is_thermal(setting.band):
        return Retrieval(None, None, brightness_temperature(radiance, setting.band))
    apparent = np.full(len(radiance), math.nan)
    hit = ground.hit
    zenith = ground[hit].sun_zenith
    apparent[hit] = apparent_reflectance(radiance[hit], zenith, setting.band)
    return Retrieval(apparent, surface_reflectance(radiance, ground, setting), None)


def apparent_reflectance(radiance: Floats, sun_zenith: Floats, band: Band) -> Floats:
    """Reflectance (n,) at the top of the atmosphere.

        pi L / (E_sun cos(sun))

    with the Sun's mean irradiance in the band at its distance. Source: Thuillier, Wang and Chance,
    as used for all products of level 1 (ESA, Sentinel-2 MSI technical guide).
    """
    cosine = np.cos(sun_zenith)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = math.pi * radiance / um / (band.irradiance * cosine)
    return np.where(cosine > 0, found, math.nan)


def surface_reflectance(radiance: Floats, ground: Ground, setting: Setting) -> Floats:
    """Reflectance (n,) of Lambertian ground on its slope, in its light of Sun and sky.

        rho = (L - L_sc) / (L_dir + L_ind of white ground)

    Source: Krutz et al. (2011), eqs. (1) and (2), solved for the reflectance.

    Accuracy  model: the air is that of the scene; the light of other ground that air scatters into
              a pixel is that of the mean ground; reflectance that depends on directions comes out
              as that of Lambertian ground. Faint where a slope is in shadow.
    """
    scattered, white = _air(ground, setting)
    out = np.full(len(radiance), math.nan)
    lit = ground.hit & (white > 0)
    out[lit] = (radiance[lit] / um - scattered[lit]) / white[lit]
    return out


def mean_reflectance(radiance: list[Floats], grounds: list[Ground], setting: Setting) -> float:
    """Mean of the surface's reflectance, which illuminates the air from below.

        rho' = mean of rho(rho'), solved by iteration over some of the pixels

    radiance, grounds  of parts of an image
    Returns            NaN for thermal radiance
    """
    if is_thermal(setting.band):
        return math.nan
    step = max(1, sum(len(one) for one in grounds) // THINNED)
    some = [(one[::step], ground[::step]) for one, ground in zip(radiance, grounds, strict=True)]
    around = FIRST
    for _ in range(ROUNDS):
        here = setting._replace(surroundings=around)
        found = np.concatenate([surface_reflectance(*one, here) for one in some])
        found = found[np.isfinite(found)]
        around = float(np.clip(found.mean(), 0, 1)) if len(found) else 0.0
    return around


def _air(ground: Ground, setting: Setting) -> tuple[Floats, Floats]:
    """Radiance (n,) of the air, and that of white ground, watt / m^2 / sr / m."""
    around = np.array([setting.surroundings])
    found = at_sensor(ground, setting.band.table, np.ones(1), around)
    scattered, direct, indirect = (
        each[:, 0].astype(np.float64) for each in (found.scattered, found.direct, found.indirect)
    )
    return scattered, direct + indirect


def brightness_temperature(radiance: Floats, band: Band) -> Floats:
    """Temperature (n,) kelvin of a blackbody whose radiance in the band is this.

    Raises    ValueError where the band has no thermal radiance.
    Accuracy  numerical: 1 mK. NaN below 50 K and above 3,000 K.
    """
    if band.heat is None:
        raise ValueError("band must be one of thermal radiance, got one below 1.5 um")
    temperature = 1 / np.linspace(1 / 50.0, 1 / 3000.0, 4000)
    table = np.log(band.heat(temperature)[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.interp(
            np.log(radiance / um), table, 1 / temperature, left=math.nan, right=math.nan
        )
        return 1 / found
