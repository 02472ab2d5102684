"""Lines of sight -> airglow of the Earth's upper atmosphere, from thin shells."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, nm
from startrack.scene.bodies import Earth
from startrack.scene.photometry import BIN, WAVELENGTH
from startrack.space import EARTH_RADIUS

RAYLEIGH = 1e10 / (4 * np.pi)  # photon / s / m^2 / sr
HIGHEST = 300e3  # metre, of all shells

# Night glow seen from the zenith, Leinert et al. (1998), A&A Supplement Series 127, 1, table 13:
# 250 R of O at 557.7 nm, 30 to 100 R of Na, 60 R of O at 630 nm; 2.5 R / nm of continuum. The bands
# of OH above 600 nm follow from the brightness of the night sky: 16 R / nm at 640 nm and 28 R / nm
# at 800 nm, from R 20.9 and I 19.7 mag per square arcsecond (Patat 2003, A&A 400, 1183), less the
# zodiacal light; above 900 nm they are an assumption.
CONTINUUM = 2.5  # R / nm
OH_AT: Floats = np.array([600.0, 640, 700, 800, 900, 1100]) * nm
OH: Floats = np.array([0.0, 8, 12, 25, 40, 90])  # R / nm


class Shell(NamedTuple):
    """Air of uniform emission between two heights, metre; lines are (wavelength, rayleigh)."""

    low: float
    high: float
    lines: tuple[tuple[float, float], ...]
    bands: bool


SHELLS = (
    Shell(82e3, 98e3, ((557.7 * nm, 250.0), (589.3 * nm, 60.0)), True),
    Shell(200e3, HIGHEST, ((630.0 * nm, 60.0),), False),
)


def airglow(earth: Earth, line: Floats) -> Iterator[tuple[Floats, Floats]]:
    """The shells' light.

        brightness = zenith brightness * path inside the shell / its thickness

    line     (n, 3) unit vectors, ICRS axes
    Yields   (k,) photon / s / m^2 / sr in each bin and (n,) 1, of which the products add up
    Accuracy  model: a factor of two from night to night; the same by day, when the limb is much
              brighter; no structure; the Earth is a sphere.
    """
    for shell in SHELLS:
        outer, inner = (_path(earth, line, height) for height in (shell.high, shell.low))
        yield spectrum(shell), (outer - inner) / (shell.high - shell.low)


@lru_cache(maxsize=4)
def spectrum(shell: Shell) -> Floats:
    """(k,) photon / s / m^2 / sr in each bin, of the shell seen in the zenith."""
    rayleigh = np.zeros_like(WAVELENGTH)
    if shell.bands:
        rayleigh += (CONTINUUM + np.interp(WAVELENGTH, OH_AT, OH)) * (BIN / nm)
    for wavelength, strength in shell.lines:
        rayleigh[np.argmin(np.abs(WAVELENGTH - wavelength))] += strength
    return rayleigh * RAYLEIGH


def _path(earth: Earth, line: Floats, height: float) -> Floats:
    """(n,) metre of each line of sight inside a sphere around the Earth, up to the ground."""
    along = line @ earth.centre
    aside = earth.centre @ earth.centre - along**2  # squared distance of the line from the centre
    half = np.sqrt(np.maximum((EARTH_RADIUS + height) ** 2 - aside, 0))
    ground = np.sqrt(np.maximum(EARTH_RADIUS**2 - aside, 0))
    hits = (aside < EARTH_RADIUS**2) & (along > 0)
    end = np.where(hits, along - ground, along + half)
    return np.maximum(end - np.maximum(along - half, 0), 0) * (half > 0)
