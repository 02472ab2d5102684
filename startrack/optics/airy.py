"""The closed forms of a clear circular pupil: irradiance, field and encircled energy."""

from __future__ import annotations

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


def fresnel_peak(radius: float, wavelength: float, image: float, distance: float) -> float:
    """Irradiance on the axis of a paraxial lens in focus, H(0) = (pi R^2 / (lambda^2 b g))^2.

    Source: Krutz et al. (2011), eq. (10).

    radius           metre, of the aperture
    image, distance  metre from the lens to the image and to the object
    Returns          1 / metre^4, as the paper counts it
    """
    return (np.pi * radius**2 / (wavelength**2 * image * distance)) ** 2


def airy_encircled(radius: Floats, wavelength: float, f_number: float) -> Floats:
    """Share of the energy in a circle: 1 - J0(v)^2 - J1(v)^2, v = pi r / (wavelength f_number).

    Source: Born and Wolf, Principles of Optics, 7th ed., section 8.5.2, eq. (18) (Rayleigh 1881).
    """
    v = np.pi * np.asarray(radius, float) / (wavelength * f_number)
    return 1 - special.j0(v) ** 2 - special.j1(v) ** 2
