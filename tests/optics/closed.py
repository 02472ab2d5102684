"""Closed forms of ideal lenses, which the package does not use."""

from __future__ import annotations

import numpy as np
from scipy import special

from startrack.core import Floats


def fresnel_peak(radius: float, wavelength: float, image: float, distance: float) -> float:
    """Irradiance on the axis of a paraxial lens, in focus: H(0) = (pi R^2 / (lambda^2 b g))^2.

    Source: Krutz et al. (2011), eq. (10).

    radius           metre, of the aperture
    image, distance  metre from the lens to the image and to the object
    Returns          1 / metre^4, as the paper counts it
    """
    return (np.pi * radius**2 / (wavelength**2 * image * distance)) ** 2


def airy_encircled(radius: Floats, wavelength: float, f_number: float) -> Floats:
    """Fraction of the energy in a circle: 1 - J0(v)^2 - J1(v)^2, v = pi r / (wavelength f_number).

    Source: Born and Wolf, Principles of Optics, 7th ed., section 8.5.2, eq. (18) (Rayleigh 1881).
    """
    v = np.pi * np.asarray(radius, float) / (wavelength * f_number)
    return 1 - special.j0(v) ** 2 - special.j1(v) ** 2
