"""Stars -> Light: photons at the entrance pupil."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from startrack.scene.parameters import Scene
from startrack.scene.photometry import SUN, WAVELENGTH, colour_temperature, photon_rate
from startrack.units import arcsec
from startrack.values import Light, Stars


def illuminate(scene: Scene, stars: Stars) -> Light:
    """The light of stars and sky; see `photometry.photon_rate` for its model and errors."""
    rate = photon_rate(stars.magnitude_g, colour_temperature(stars.colour))
    return Light(stars.direction, WAVELENGTH, rate, _sky(scene.background_g))


@lru_cache(maxsize=64)
def _sky(background_g: float | None) -> NDArray[np.float64]:
    """Photon / s / m^2 / sr in each bin; the sky is sunlight scattered by dust."""
    if background_g is None:
        return np.zeros_like(WAVELENGTH)
    return photon_rate(np.array([background_g]), np.array([SUN]))[0] / arcsec**2
