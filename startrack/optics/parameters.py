"""Optics: focal length, aperture, blur, transmission."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from startrack.checks import non_negative, one_of, positive, within
from startrack.curve import ALL, Curve
from startrack.units import Unit


@dataclass(frozen=True)
class Optics:
    """A lens.

    focal_length  metre
    f_number      1, focal length over the diameter of the clear aperture
    blur          metre, sigma of the Gaussian that defocus and aberrations add to diffraction,
                  on the detector
    psf           "airy": diffraction of a circular pupil over the band, convolved with the blur;
                  "gaussian": one Gaussian, the core of that
    transmission  1 over wavelength
    principal_x, principal_y  pixel from the centre of the detector to where the axis meets it
    k1, k2, p1, p2, k3        OpenCV's distortion coefficients
    """

    focal_length: Annotated[float, Unit("m", "mm")]
    f_number: float
    blur: Annotated[float, Unit("m", "um")] = 0.0
    psf: str = "airy"
    transmission: Curve = ALL
    principal_x: float = 0.0
    principal_y: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        positive(focal_length=self.focal_length)
        within(0.3, 200, f_number=self.f_number)
        non_negative(blur=self.blur)
        one_of(("airy", "gaussian"), psf=self.psf)

    @property
    def aperture(self) -> float:
        """Diameter of the clear aperture, metre."""
        return self.focal_length / self.f_number

    @property
    def area(self) -> float:
        """Area of the clear aperture, square metre."""
        return math.pi / 4 * self.aperture**2
