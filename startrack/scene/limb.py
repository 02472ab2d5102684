"""Lines of sight that pass close over the Earth -> the light of its air."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from startrack.scene.bodies import EARTH_ALBEDO, Earth
from startrack.scene.ephemeris import EARTH_RADIUS
from startrack.scene.photometry import WAVELENGTH
from startrack.shipped import shipped

if TYPE_CHECKING:
    from startrack.scene.air import Limb

Floats = NDArray[np.float64]


def limb_light(earth: Earth, line: Floats) -> Iterator[tuple[Floats, Floats]]:
    """The sunlit air above the horizon.

    line     (n, 3) unit vectors, ICRS axes
    Yields   (k,) photon / s / m^2 in each bin and (n,) 1 / sr, of which the products add up: one
             for each wavelength of the table, which stands for the bins nearest to it
    Errors   model: that of `Limb`, over a ground of albedo 0.3; the Earth is a sphere.
    """
    table = _table()
    along = line @ earth.centre
    nearest = along[:, None] * line - earth.centre  # from the Earth's centre
    distance = np.linalg.norm(nearest, axis=1)
    height = distance - EARTH_RADIUS
    through = np.flatnonzero((along > 0) & (height >= 0) & (height < table.tangent[-1]))
    if not len(through):
        return
    zenith = nearest[through] / distance[through, None]
    cosine = np.clip(zenith @ earth.sun, -1, 1)
    level = earth.sun - cosine[:, None] * zenith
    towards = np.einsum("ij,ij->i", line[through], level)
    azimuth = np.arccos(np.clip(towards / np.maximum(np.linalg.norm(level, axis=1), 1e-12), -1, 1))
    found = table(table.wavelength, height[through], np.arccos(cosine), azimuth)
    sunlight = earth.light * np.pi / EARTH_ALBEDO
    stands_for = np.argmin(np.abs(WAVELENGTH - table.wavelength[:, None]), axis=0)
    for i in range(len(table.wavelength)):
        share = np.zeros(len(line))
        share[through] = found[:, i]
        yield np.where(stands_for == i, sunlight, 0.0), share


@lru_cache(maxsize=1)
def _table() -> Limb:
    from startrack.scene.air import load_limb  # few scenes have an Earth

    return load_limb(shipped("atmosphere/limb.fits"))
