"""Light enters; electrons per second of stars, sky and diffuse light leave (equation 4)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from startrack.core import Camera, Floats, Light
from startrack.detector.parameters import Detector


def electron_rate(light: Light, detector: Detector, throughput: Floats) -> tuple[Floats, Floats]:
    """Electrons per second of each star, and the surface brightness of the sky.

        rate = sum_k photon_rate_k throughput_k QE(lambda_k) fill factor

    Source: Krutz et al. (2011), eq. (4), for a point source.

    throughput  (k,) square metre, aperture times transmission
    Returns     (n,) electron / s; electron / s / sr
    """
    per_photon = efficiency(light, detector, throughput)
    return light.photon_irradiance @ per_photon, light.background @ per_photon


def efficiency(light: Light, detector: Detector, throughput: Floats) -> Floats:
    """(k,) electron m^2 / photon in each bin of the light."""
    return detector.quantum_efficiency(light.wavelength) * detector.fill_factor * throughput


def glow_of(light: Light, camera: Camera, detector: Detector, throughput: Floats) -> Floats | None:
    """Expected electrons (rows, columns) of what varies over the field, None where nothing does.

    throughput  (k,) square metre, aperture times transmission
    Accuracy    model: the solid angle of a pixel is that on the boresight.
    """
    if not light.diffuse:
        return None
    per_photon = efficiency(light, detector, throughput)
    scale = camera.focal_length_px**-2 * detector.exposure
    electrons = np.zeros((detector.rows, detector.columns))
    for glow in light.diffuse:
        down, across = (
            _straight(nodes, pixels)
            for nodes, pixels in zip(glow.fraction.shape, electrons.shape, strict=True)
        )
        electrons += down @ (glow.fraction * (glow.spectrum @ per_photon * scale)) @ across.T
    return electrons


@lru_cache(maxsize=8)
def _straight(nodes: int, pixels: int) -> Floats:
    """(pixels, nodes) weights of straight lines between evenly spaced nodes."""
    place = np.linspace(0, nodes - 1, pixels)
    return np.maximum(1 - np.abs(place[:, None] - np.arange(nodes)), 0.0)
