"""DaySky at night -> airglow, zodiacal light and light of faint stars."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from startrack.core import GOLDEN_ANGLE, Floats, deg, nm
from startrack.scene.background import starlight, starlight_spectrum, zodiacal, zodiacal_spectrum
from startrack.scene.day_sky import DaySky
from startrack.scene.limb import SHELLS, Shell, spectrum
from startrack.scene.photometry import SUN, SUN_G_MINUS_V, WAVELENGTH, photon_irradiance
from startrack.space import EARTH_RADIUS

FAINTEST = 8.0  # G of the faintest stars with separate spots, as in the shipped catalogue
FROM_SUN = 60 * deg  # least distance from the Sun at which a night sky has zodiacal light
DIRECTIONS = 4000  # over the sphere, for a mean within 0.2 %
# Johnson's V as a Gaussian, with mean and full width at half maximum of Bessell (1990), PASP 102,
# 1181.
V_MIDDLE, V_WIDTH = 551 * nm, 88 * nm


def night_light(sky: DaySky) -> Floats:
    """(bins,) photon / s / m^2 / sr of a clear and moonless night sky in the line of sight.

        shells of airglow * path through them + zodiacal light + stars fainter than G 8

    The last two are means over the sphere; the zodiacal light beyond 60 degrees from the Sun. If
    `night_v` is given, the sum is scaled to it.

    Source    of the shells: Leinert et al. (1998) and Patat (2003), see `limb.SHELLS`
    Accuracy  model: 0.3 mag. Airglow changes by this from night to night and with the Sun's
              activity. The zodiacal light varies by this over the sky, the Milky Way by more.
              Extinction is left out, because the air scatters about as much diffuse light into the
              line of sight as out of it: 15 % at the zenith, more near the horizon.
    """
    light = _natural(sky.height, sky.elevation)
    if sky.night_v is not None:
        overhead = surface_v(_natural(sky.height, math.pi / 2))
        light = light * 10 ** (0.4 * (overhead - sky.night_v))
    return light


def _natural(height: float, elevation: float) -> Floats:
    """Light (bins,) of a night far from cities, photon / s / m^2 / sr.

    height     metre, of the camera
    elevation  radian, of the line of sight
    """
    glow = sum(spectrum(shell) * _path(shell, height, elevation) for shell in SHELLS)
    return np.asarray(glow + _beyond_the_air())


def surface_v(light: Floats) -> float:
    """V magnitude per square arcsecond of light (bins,), photon / s / m^2 / sr."""
    passband = np.exp(-4 * math.log(2) * ((WAVELENGTH - V_MIDDLE) / V_WIDTH) ** 2)
    star = photon_irradiance(np.array([SUN_G_MINUS_V]), np.array([SUN]))[0]  # of V = 0
    return -2.5 * math.log10(float(light @ passband) * deg**2 / 3600**2 / float(star @ passband))


def _path(shell: Shell, height: float, elevation: float) -> float:
    """Path through a shell, relative to that towards the zenith (van Rhijn 1921)."""
    middle = (shell.low + shell.high) / 2
    level = (EARTH_RADIUS + height) / (EARTH_RADIUS + middle) * math.cos(elevation)
    return 1 / math.sqrt(1 - level**2)


@lru_cache(maxsize=1)
def _beyond_the_air() -> Floats:
    """Zodiacal light and light of faint stars, photon / s / m^2 / sr in each bin."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * k / DIRECTIONS, GOLDEN_ANGLE * k
    level = np.sqrt(1 - z**2)
    direction = np.column_stack([level * np.cos(turn), level * np.sin(turn), z])
    sun = np.array([1.0, 0.0, 0.0])  # at the equinox
    far = direction[direction @ sun < math.cos(FROM_SUN)]
    dust, stars = float(zodiacal(far, sun).mean()), float(starlight(direction, FAINTEST).mean())
    return dust * zodiacal_spectrum() + stars * starlight_spectrum()
