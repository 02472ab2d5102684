"""DaySky -> photons of the sky above a camera at any hour, and loss of starlight in the air."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from startrack.core import Floats
from startrack.scene.air_above import SkyTable, day_light, sky_table, starlight_through
from startrack.scene.day_sky import DaySky, SunPlace
from startrack.scene.dusk import dusk_light
from startrack.scene.moonlight import moonlight
from startrack.scene.night import night_light


class SkyLight(NamedTuple):
    """Light that the air adds, and transmittance of the air.

    background  (bins,) photon / s / m^2 / sr
    through     (bins,) 1, transmittance for stars in the line of sight
    """

    background: Floats
    through: Floats


@lru_cache(maxsize=64)
def sky_light(sky: DaySky, date: str | None = None) -> SkyLight:
    """Light of the sky in the line of sight, and transmittance of the air above the camera.

        sunlight by day or in twilight + moonlight + light of the night

    Source: sasktran2 (Zawada et al.), by catalogs/atmosphere; the Sun and gases as for Earth
    cameras.

    date      UTC, if the sky is `dated`; without a date there is no Moon
    Accuracy  model: clear air without clouds, no polarisation (up to 10 % at 400 nm, 3 % from 600
              nm on). The aerosol of a real stratosphere differs by a factor of two and more. Lines
              of gases are averaged over bins of 10 nm. The Sun is one astronomical unit away
              (3 %). numerical: 2 % of the solver from 5 degrees
              of distance from the Sun on; in twilight that of `dusk_light`, at night that of
              `night_light`.
    """
    table, sun = sky_table(), sky.sun(date)
    light = scattered(table, sky, sun) * table.irradiance
    light = light + night_light(sky) if sun.elevation < 0 else light
    if date is not None and sky.dated:
        moon, irradiance = moonlight(sky, date)
        light = light + scattered(table, sky, moon) * irradiance
    return SkyLight(light, starlight_through(table, sky))


def scattered(table: SkyTable, sky: DaySky, lamp: SunPlace) -> Floats:
    """(bins,) 1 / sr, light of the Sun or the Moon scattered by the air, over its irradiance."""
    if lamp.elevation < 0:
        return dusk_light(table, sky, lamp)
    return day_light(table, sky, lamp)
