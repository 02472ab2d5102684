"""Optics -> Psf: the share of a star's light that each pixel takes, for any sub-pixel place."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special
from scipy.interpolate import CubicSpline

from startrack.optics.parameters import Optics
from startrack.optics.transfer import blur_transfer, pixel_transfer, pupil_transfer
from startrack.values import Psf

Floats = NDArray[np.float64]

AIRY_SIGMA = math.sqrt(2) / math.pi  # wavelength * f-number: peak and energy of the Airy disk
GAUSSIAN_BOX = 6.0  # sigma, half width of the table: 2e-9 of the energy lies outside
AIRY_BOX = 6.0  # wavelength * f-number, half width of the table beyond the blur


def focus(optics: Optics, pitch: float, wavelength: Floats, weight: Floats) -> Psf:
    """The pixel-integrated PSF, tabulated.

        Psf(x, y) = F^-1 [ sum_k weight_k pupil(f; wavelength_k) * blur(f) * pixel(fx) pixel(fy) ]

    Source: Krutz et al. (2011), eqs. (17)-(20), as products of transfer functions.

    pitch       metre, side of a pixel
    wavelength  (k,) metre
    weight      (k,) shares of the detected photons; need not sum to one
    Errors      model: "gaussian" has no rings; the share outside the table is 1 - Psf.energy.
                numerical: see `pixel_response`.
    """
    weight = weight / weight.sum()
    mean_wavelength = float(weight @ wavelength)
    core = math.hypot(AIRY_SIGMA * mean_wavelength * optics.f_number, optics.blur) / pitch
    if optics.psf == "gaussian":
        return _gaussian(core)
    used = weight > 1e-6

    def transfer(frequency: Floats) -> Floats:
        pupil = np.zeros_like(frequency)
        for share, each in zip(weight[used], wavelength[used], strict=True):
            pupil += share * pupil_transfer(frequency, each, optics.f_number)
        return pupil * blur_transfer(frequency, optics.blur)

    reach = AIRY_BOX * mean_wavelength * optics.f_number + 5 * optics.blur
    return pixel_response(transfer, pitch, reach / pitch, finest=core)


def _gaussian(sigma: float) -> Psf:
    """A Gaussian of `sigma` pixel: the table is a product of differences of error functions."""
    oversampling = _oversampling(sigma)
    half = _half(GAUSSIAN_BOX * sigma, oversampling)
    x = np.arange(-half, half + 1) / oversampling
    line = special.ndtr((x + 0.5) / sigma) - special.ndtr((x - 0.5) / sigma)
    inside = 1 - 2 * special.ndtr(-(half / oversampling) / sigma)
    return Psf(np.outer(line, line), oversampling, inside**2)


def pixel_response(
    transfer: Callable[[Floats], Floats], pitch: float, half_width: float, finest: float
) -> Psf:
    """Turn a transfer function that depends on |f| alone into a table of pixel responses.

    transfer    function of (...) cycle / metre that returns (...) 1
    pitch       metre
    half_width  pixel, wanted reach of the table
    finest      pixel, the scale on which the image varies; sets the sampling
    Errors      numerical: the period of the transform is four times the table, so that the
                faint wings that fold back add at most 2 % of what lies outside the table.
    """
    oversampling = _oversampling(finest)
    half = _half(half_width, oversampling)
    samples = fft.next_fast_len(8 * half, real=True)
    fx = fft.rfftfreq(samples, pitch / oversampling)
    fy = fft.fftfreq(samples, pitch / oversampling)
    radius = np.hypot(fx, fy[:, None])
    # A transfer function of one variable is costly to evaluate on the plane, cheap on a line.
    line = np.linspace(0, radius.max(), 4 * samples)
    spectrum = CubicSpline(line, transfer(line))(radius)
    spectrum *= pixel_transfer(fx, pitch) * pixel_transfer(fy, pitch)[:, None]
    plane = fft.irfft2(spectrum, s=(samples, samples)) * oversampling**2
    around = np.r_[-half : half + 1]
    table = plane[np.ix_(around, around)]
    # All light is counted once by the pixels of any sub-pixel phase; their mean is the energy.
    edge = np.ones(2 * half + 1)
    edge[[0, -1]] = 0.5
    energy = float(edge @ table @ edge) / oversampling**2
    return Psf(np.ascontiguousarray(table), oversampling, min(energy, 1.0))


def _oversampling(finest: float) -> int:
    """Samples per pixel that let six-point interpolation reach 1e-6 of the peak."""
    return int(np.clip(math.ceil(6 / max(finest, 1e-3)), 8, 48))


def _half(width: float, oversampling: int) -> int:
    """Samples from the centre to the edge of the table: the reach, half a pixel, and the taps."""
    return math.ceil((max(width, 1.0) + 0.5) * oversampling) + 3
