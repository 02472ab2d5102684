"""Closed forms: irradiance, energy and transfer functions of an ideal lens, a Gaussian, a pixel."""

import numpy as np
from scipy import special

from startrack.core import Floats


def airy(radius: Floats, wavelength: float, f_number: float) -> Floats:
    """Irradiance at the focus of a clear circular pupil, relative to its peak.

        E(r) / E(0) = [2 J1(v) / v]^2,  v = pi r / (wavelength f_number)

    Source: Krutz et al. (2011), eq. (8), where f_number is the image distance over 2 R.

    radius    (...) metre from the centre
    Returns   (...) 1, in [0, 1]
    Accuracy  model: scalar, paraxial.  numerical: 1e-15 of the peak.
    """
    return np.square(jinc(np.pi * np.asarray(radius, float) / (wavelength * f_number)))


def jinc(v: Floats) -> Floats:
    """2 J1(v) / v, one at v = 0.

    Accuracy  numerical: 1e-15. Below v = 1e-8 the quotient is one to the last digit.
    """
    tiny = np.abs(v) < 1e-8
    safe = np.where(tiny, 1.0, v)
    return np.where(tiny, 1.0, 2 * special.j1(safe) / safe)


def pupil_transfer(frequency: Floats, wavelength: float, f_number: float) -> Floats:
    """Transfer function of a clear circular pupil without aberrations.

        2 / pi * (acos s - s sqrt(1 - s^2)),  s = frequency * wavelength * f_number

    Source: Goodman, Introduction to Fourier Optics, 3rd ed., eq. (6-32).

    frequency  (...) cycle / metre on the detector
    Returns    (...) 1; zero from s = 1 on
    """
    s = np.minimum(np.abs(frequency) * (wavelength * f_number), 1.0)
    return 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s * s))


def blur_transfer(frequency: Floats, sigma: float) -> Floats:
    """Transfer function of a Gaussian: exp(-2 (pi sigma frequency)^2); sigma in metre."""
    return np.exp(-2 * (np.pi * sigma * frequency) ** 2)


def pixel_transfer(frequency: Floats, pitch: float) -> Floats:
    """Transfer function of a pixel along one axis: sin(pi pitch f) / (pi pitch f)."""
    return np.sinc(frequency * pitch)
