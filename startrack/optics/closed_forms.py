"""Closed forms: irradiance, energy and transfer functions of an ideal lens, a Gaussian, a pixel."""

import numpy as np
from scipy import special

from startrack.core import Floats, positive


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


def gaussian(
    x_image: Floats,
    y_image: Floats,
    x_object: float,
    y_object: float,
    focal_length: float,
    distance: float | Floats,
    sigma: float,
) -> Floats:
    """Irradiance in the image of an object point, per unit area of object.

        H = (f/g)^2 / (2 pi sigma^2) exp(-((f x'/g + x'')^2 + (f y'/g + y'')^2) / (2 sigma^2))

    Source: Krutz et al. (2011), eq. (12), with the sign of the exponent and its y' corrected; eq.
    (13) is the same with g(t), an array of distances.

    x_image, y_image    (...) metre, x'', y''
    x_object, y_object  metre, x', y'; the image is inverted
    distance            metre, g or g(t), broadcast against the image points
    sigma               metre, in the image
    Returns             (...) 1 / metre^2; over the image its integral is (f/g)^2
    Accuracy            model: no rings and no far wings.
    """
    positive(focal_length=focal_length, sigma=sigma, distance=float(np.min(distance)))
    scale = focal_length / np.asarray(distance, float)
    square = (scale * x_object + x_image) ** 2 + (scale * y_object + y_image) ** 2
    return scale**2 / (2 * np.pi * sigma**2) * np.exp(-square / (2 * sigma**2))
