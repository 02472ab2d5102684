"""Light and detector -> electrons of stars, of the background and of diffuse light (equation 4)."""

import cv2
import numpy as np

from startrack.core import Camera, Floats, Light, kept
from startrack.detector.law import Tables, law_of, tables_for
from startrack.detector.maps import dark, response
from startrack.detector.parameters import Detector

# Standard deviations above the background; this range includes most pixels in the wings of stars.
# By hand: a larger value makes larger tables, with a smaller one more pixels are drawn one by one.
# The numbers do not change.
STAR_WINGS = 0.6


def electron_rate(light: Light, detector: Detector, throughput: Floats) -> tuple[Floats, Floats]:
    """Electrons per second of each star, and of the background per solid angle.

        rate = sum_k photon_irradiance_k throughput_k fill_factor

    Source: Krutz et al. (2011), eq. (4), for a point source.

    throughput  (k,) electron m^2 / photon, aperture times transmission times quantum efficiency
    Returns     (n,) electron / s; electron / s / sr
    """
    per_photon = efficiency(detector, throughput)
    return light.photon_irradiance @ per_photon, light.background @ per_photon


def efficiency(detector: Detector, throughput: Floats) -> Floats:
    """Throughput with fill factor: (k,) electron m^2 / photon in each spectral bin."""
    per_photon = detector.fill_factor * throughput
    return per_photon * detector.sensitivity if detector.age else per_photon


def mean_wavelength(light: Light, detector: Detector, throughput: Floats) -> Floats:
    """Mean wavelength (n,) of the detected photons of each star, metre.

    A star without photons has the mean wavelength of a flat spectrum.
    """
    per_photon = efficiency(detector, throughput)
    even = float(per_photon @ light.wavelength / max(per_photon.sum(), 1e-300))
    rate = light.photon_irradiance @ per_photon
    total = light.photon_irradiance @ (per_photon * light.wavelength)
    return np.where(rate > 0, total / np.where(rate > 0, rate, 1.0), even)


def diffuse_electrons(
    light: Light, camera: Camera, detector: Detector, throughput: Floats
) -> Floats | None:
    """Expected electrons (rows, columns) of diffuse light; None without such light.

    throughput  (k,) electron m^2 / photon, as `electron_rate`
    Accuracy    model: the solid angle of a pixel is that on the boresight.
    """
    if not light.diffuse:
        return None
    per_photon = efficiency(detector, throughput)
    scale = camera.focal_length_px**-2 * detector.exposure
    electrons = np.zeros((detector.rows, detector.columns))
    for diffuse_light in light.diffuse:
        # Weights (pixels, nodes) of linear interpolation between evenly spaced nodes.
        down, across = (
            np.maximum(1 - np.abs(np.linspace(0, n - 1, side)[:, None] - np.arange(n)), 0.0)
            for n, side in zip(diffuse_light.fraction.shape, electrons.shape, strict=True)
        )
        brightness = diffuse_light.spectrum @ per_photon * scale
        electrons += down @ (diffuse_light.fraction * brightness) @ across.T
    return electrons


@kept(4)
def background(detector: Detector, sky: float) -> Floats:
    """Expected electrons (rows, columns) of a uniform background and the dark current; read-only.

        background = crosstalk(response sky) + dark current * exposure

    sky  electron of the uniform background in a pixel of mean response
    """
    electrons = apply_response(np.full((detector.rows, detector.columns), float(sky)), detector)
    electrons += dark(detector) * detector.exposure
    electrons.flags.writeable = False
    return electrons


def apply_response(electrons: Floats, detector: Detector) -> Floats:
    """Expected electrons (rows, columns) of extended light after response and crosstalk.

    electrons  (rows, columns) in pixels of mean response; overwritten
    """
    gain = response(detector)
    if gain is not None:
        electrons *= gain
    return diffuse(electrons, detector.crosstalk) if detector.crosstalk else electrons


@kept(4)
def background_tables(detector: Detector, sky: float) -> Tables:
    """Tables of the numbers of a frame, from its background alone; frames share them.

    Arguments as `background`.
    """
    return tables_for(background(detector, sky) * (1 - detector.lag), law_of(detector), STAR_WINGS)


def carry(electrons: Floats, before: Floats | None, fraction: float) -> Floats:
    """Expected electrons that are read with a frame, with residual charge of the previous frame.

        read = (1 - fraction) electrons + fraction before

    Each electron is left behind independently, so that the numbers remain Poisson distributed.

    Source: Janesick (2001), Scientific Charge-Coupled Devices, on deferred charge; in this model it
    comes only from one frame.

    electrons  (rows, columns) electron, generated in this frame
    before     (rows, columns) electron, generated in the previous frame; None: none
    """
    kept = (1 - fraction) * electrons
    return kept if before is None else kept + fraction * before


def diffuse(electrons: Floats, fraction: float) -> Floats:
    """Expected electrons after crosstalk: a fraction diffuses from each pixel to each of its sides.

        after = (1 - 4 fraction) electrons + fraction (left + right + above + below)

    Electrons diffuse independently. Therefore the numbers stay independent and Poisson distributed,
    and it is enough to spread their expectations.

    Source: Janesick (2001), Scientific Charge-Coupled Devices, on diffusion; in this model only to
    the nearest pixels.

    electrons  (rows, columns) electron; none crosses the border of the array
    fraction   1, at most 1/4
    """
    kernel = np.array([[0, fraction, 0], [fraction, 1 - 4 * fraction, fraction], [0, fraction, 0]])
    return np.asarray(cv2.filter2D(electrons, -1, kernel, borderType=cv2.BORDER_REFLECT), float)
