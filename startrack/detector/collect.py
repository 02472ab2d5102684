"""Light -> electrons per second: the integral over wavelength of equation (4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.detector.parameters import Detector
from startrack.values import Light

Floats = NDArray[np.float64]


def electron_rate(light: Light, detector: Detector, throughput: Floats) -> tuple[Floats, Floats]:
    """Electrons per second of each star, and the surface brightness of the sky.

        rate = sum_k photon_rate_k throughput_k QE(lambda_k) fill factor

    Source: Krutz et al. (2011), eq. (4), for a point source.

    throughput  (k,) square metre, aperture times transmission
    Returns     (n,) electron / s; electron / s / sr
    """
    per_photon = efficiency(light, detector, throughput)
    return light.photon_rate @ per_photon, light.background @ per_photon


def efficiency(light: Light, detector: Detector, throughput: Floats) -> Floats:
    """(k,) electron m^2 / photon in each bin of the light."""
    return detector.quantum_efficiency(light.wavelength) * detector.fill_factor * throughput
