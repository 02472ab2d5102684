"""Directions, faintest magnitude of the catalogue -> light of fainter stars."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from startrack.core import GALACTIC_POLE, Floats, deg
from startrack.scene.photometry import photon_irradiance

# Light of the stars towards the galactic poles in each whole magnitude G, in stars of G = 10 per
# square degree. G 4 to 10: counted in Gaia DR3 and Hipparcos beyond 70 degrees of latitude.
# Brighter: from the counts within 5 degrees of the plane, where such stars are many. Fainter: its
# fall from magnitude to magnitude by the disk of Bahcall and Soneira (1980), Astrophysical
# Journal Supplement 44, 73, eq. (B1).
FIRST, LAST = 0.0, 24.0
COUNTED = (1.5, 2.0, 2.6, 3.0, 3.56, 4.55, 5.44, 4.90, 4.84, 4.32)
# Sine of the latitude below which dust limits the brightness of the plane; fitted to the counts of
# all belts of latitude.
DUST = 0.2
# Starlight that dust scatters, over the starlight: Leinert et al. (1998), A&A Supplement Series
# 127, 1, section 11.2.
SCATTERED = 0.25
TEMPERATURE = 4800.0  # kelvin, of a blackbody with the mean star's colour


def starlight(direction: Floats, limit_g: float) -> Floats:
    """Brightness of faint stars that a catalogue leaves out, and of dust in the light of all stars.

        light(G, b) = light(G + 5 log10 s, pole) / s,   s^2 = sin(b)^2 + 0.2^2

    which is exact for a plane layer of stars without dust: at a low latitude b, more and farther
    stars are seen.

    direction  (n, 3) unit vectors, ICRS axes
    limit_g    G of the faintest star of the catalogue
    Returns    (n,) stars of G = 10 per square degree
    Accuracy   model: mean over galactic longitude; 15 % of the counts of the belts of latitude down
               to G 10, 30 % beyond; clouds and rifts of the Milky Way a factor of two.
    """
    step = np.hypot(direction @ GALACTIC_POLE, DUST)
    edge, light = _fainter()
    faint = np.interp(limit_g + 5 * np.log10(step), edge, light)
    return (faint + SCATTERED * light[0]) / step


@lru_cache(maxsize=1)
def starlight_spectrum() -> Floats:
    """Photon / s / m^2 / sr in each bin, where there is one star of G = 10 per square degree."""
    return photon_irradiance(np.array([10.0]), np.array([TEMPERATURE]))[0] / deg**2


@lru_cache(maxsize=1)
def _fainter() -> tuple[Floats, Floats]:
    """Magnitudes, and the light of all fainter stars towards the pole."""
    light = list(COUNTED)
    while FIRST + len(light) < LAST:
        light.append(light[-1] * 10 ** (_growth(FIRST + len(light)) - 0.4))
    below = np.append(np.cumsum(light[::-1])[::-1], 0.0)
    return FIRST + np.arange(len(below), dtype=np.float64), below


def _growth(magnitude: float) -> float:
    """Decimal logarithm of the growth of the number of disk stars from a magnitude to the next."""
    x = 10 ** (-0.132 * (magnitude - 15.75))
    return 0.035 + 0.132 * 3.0 * x / (1 + x)
