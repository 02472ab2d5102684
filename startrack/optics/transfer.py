"""Transfer functions: each factor of the blur over spatial frequency."""

from __future__ import annotations

import numpy as np

from startrack.core import Floats


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
