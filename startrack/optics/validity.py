"""How far the Fresnel integral may be trusted: the paper's criterion, and a stable one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from startrack.core import positive, whole


def paper_radius(focal_length: float, distance: float, wavelength: float, order: int = 1) -> float:
    """Radius at which the integrand of eq. (9) has its first, second, ... zero in part.

        (R / lambda)^4 = (8 (alpha + beta) - 2 l) / (1/alpha^3 + 1/beta^3)
        alpha = g / lambda,  beta = b / lambda,  l the largest whole numbers that keep it positive

    Source: Krutz et al. (2011), eq. (11). It is kept as history: the zeros of the real and the
    imaginary part depend on the phase origin k (b + g), so that the radius jumps as the path grows
    by a fraction of a wave. At f = 20 mm, g = 1 m a change of the wavelength from 500 nm by 1e-5 nm
    takes it from 1.27 mm to 1.05 mm. Use `fresnel_radius`.

    focal_length, distance, wavelength  metre; the distance must be finite
    order                               1 for the first zero
    Returns                             metre; the f-number limit is focal_length / (2 R)
    Raises                              ValueError where there is no image.
    """
    beyond = _image(focal_length, distance)
    positive(wavelength=wavelength)
    whole(1, 1000, order=order)
    alpha, beta = distance / wavelength, beyond / wavelength
    eight = 8 * (alpha + beta)
    last = math.ceil(eight / 2) - 1  # the largest l with eight - 2 l > 0
    rest = eight - 2 * (last - (order - 1))
    return wavelength * (rest / (alpha**-3 + beta**-3)) ** 0.25


@dataclass(frozen=True)
class Limit:
    """The largest aperture that keeps the spherical phase defect under a tolerance.

    radius  metre
    error   1, bound on what Fresnel's peak is too high by, relative to it
    """

    radius: float
    error: float


def fresnel_radius(
    focal_length: float, distance: float, wavelength: float, tolerance: float
) -> Limit:
    """The stable criterion, which knows no phase origin.

        (2 pi / lambda) (R^4 / 8) (1/b^3 + 1/g^3) = tolerance

    The defect is at most tolerance t^2 with t = (r/R)^2 uniform over the lens, and
    1 - |<exp(i phi)>|^2 <= Var(phi) = 4/45 tolerance^2. The inclination b^2 g^2 / ((r^2 + b^2)
    (r^2 + g^2)) takes at most R^2 (1/b^2 + 1/g^2) more.

    Source: the next term of both square roots in Krutz et al. (2011), eq. (9), after the parabola.

    distance   metre, or infinity
    tolerance  radian, at the rim
    """
    beyond = _image(focal_length, distance)
    positive(wavelength=wavelength, tolerance=tolerance)
    curve = beyond**-3 + distance**-3
    radius = (8 * tolerance * wavelength / (2 * math.pi) / curve) ** 0.25
    return Limit(radius, fresnel_error(focal_length, distance, wavelength, radius))


def fresnel_error(focal_length: float, distance: float, wavelength: float, radius: float) -> float:
    """Bound on how far Fresnel's peak lies above Kirchhoff's for a parabolic lens, relative to it.

    Accuracy  a bound while the result is below one; it exceeds the true error by a fifth at 20 %.
    """
    beyond = _image(focal_length, distance)
    positive(wavelength=wavelength, radius=radius)
    defect = 2 * math.pi / wavelength * radius**4 / 8 * (beyond**-3 + distance**-3)
    return 4 / 45 * defect**2 + radius**2 * (beyond**-2 + distance**-2)


def _image(focal_length: float, distance: float) -> float:
    positive(focal_length=focal_length)
    if not distance > focal_length:
        raise ValueError(
            "distance must be beyond the focal length, where a real image forms, got "
            f"{distance:g} m at a focal length of {focal_length:g} m"
        )
    return 1 / (1 / focal_length - 1 / distance)
