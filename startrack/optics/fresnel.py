"""Fresnel diffraction of any pupil near the image plane by a fast chirp transform; its limits.

    U(x) = Int P(xi) exp(i pi/lambda (1/z - 1/b) |xi|^2) exp(-2 pi i xi x / (lambda z)) d^2xi

Source: Krutz et al. (2011), eqs. (8) and (10): the lens cancels the quadratic phase of the image
plane z = b, and a clear circle gives 2 J1(v) / v. The transform onto a small field at any spacing
is a chirp convolution, Rabiner, Schafer and Rader (1969), Bell Syst. Tech. J. 48, 1249.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from startrack.core import Floats, Refused, positive, whole

Complex = NDArray[np.complex128]


def fresnel(
    pupil: Complex,
    coordinate: Floats,
    radius: float,
    wavelength: float,
    image: float,
    plane: float,
    spacing: float,
    count: int,
) -> Complex:
    """The amplitude on a square grid, relative to that of the open circle on the axis in focus.

    pupil       (n, n) 1, open area and aberrations, rows along y
    coordinate  (n,) 1, of its samples in radii, evenly spaced and symmetric about zero
    radius      metre, of the aperture
    image       metre from the lens to the image, b
    plane       metre from the lens to the plane, z
    spacing     metre between the points of the grid
    count       points along a side, odd; the axis is in the middle
    Returns     (count, count), rows along y
    Raises      ValueError where the samples of the pupil do not resolve the phase of the plane.
    Accuracy    model: paraxial.  numerical: 1e-13, besides the sampling of the pupil. The effort is
                n log n for each row, for any spacing.
    """
    positive(radius=radius, wavelength=wavelength, image=image, plane=plane, spacing=spacing)
    cell = (coordinate[1] - coordinate[0]) * radius
    curvature = (1 / plane - 1 / image) / wavelength
    per_cell = abs(curvature) * radius * cell + (count // 2) * spacing * cell / (wavelength * plane)
    if per_cell > 0.5:
        raise Refused(
            f"the pupil must have two samples a wave, got {1 / per_cell:.2f}: take at least "
            f"{math.ceil(2 * per_cell * len(coordinate))} samples"
        )
    xi = coordinate * radius
    wave = pupil * np.exp(1j * math.pi * curvature * (xi**2 + xi[:, None] ** 2))
    step = cell * spacing / (wavelength * plane)  # cycles from sample to sample and point to point
    first = -(count // 2)
    transform = scipy.signal.CZT(
        len(coordinate), count, w=np.exp(-2j * np.pi * step), a=np.exp(2j * np.pi * step * first)
    )
    # The transform counts samples from zero; the pupil starts at coordinate[0].
    start = np.exp(-2j * np.pi * step * (first + np.arange(count)) * (xi[0] / cell))
    rows = transform(wave, axis=1) * start
    plane_wave = transform(rows, axis=0) * start[:, None]
    # |U| in focus is the area over lambda b; elsewhere the wave spreads over lambda z.
    return plane_wave * (cell**2 / (math.pi * radius**2) * image / plane)


def paper_radius(focal_length: float, distance: float, wavelength: float, order: int = 1) -> float:
    """Radius of the first, second, ... zero of a part, real or imaginary, of eq. (9)'s integrand.

        (R / lambda)^4 = (8 (alpha + beta) - 2 l) / (1/alpha^3 + 1/beta^3)
        alpha = g / lambda,  beta = b / lambda,  with the largest integers l that keep it positive

    Source: Krutz et al. (2011), eq. (11). It serves for comparison with the paper alone: the zeros
    of both parts depend on the phase origin k (b + g), so that the radius jumps when the path
    grows by a fraction of a wave. At f = 20 mm, g = 1 m a change of the wavelength from 500 nm by
    1e-5 nm changes it from 1.27 mm to 1.05 mm. Use `fresnel_radius`.

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
    """The largest aperture whose spherical phase defect is below a tolerance.

    radius  metre
    error   1, bound on the relative excess of Fresnel's peak over Kirchhoff's
    """

    radius: float
    error: float


def fresnel_radius(
    focal_length: float, distance: float, wavelength: float, tolerance: float
) -> Limit:
    """Largest radius by the spherical phase defect, a criterion without a phase origin.

        (2 pi / lambda) (R^4 / 8) (1/b^3 + 1/g^3) = tolerance

    The defect is at most tolerance t^2 with t = (r/R)^2 uniform over the lens, and
    1 - |<exp(i phi)>|^2 <= Var(phi) = 4/45 tolerance^2. The inclination b^2 g^2 / ((r^2 + b^2)
    (r^2 + g^2)) reduces the peak by at most R^2 (1/b^2 + 1/g^2) more.

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
    """Bound on the relative excess of Fresnel's peak over Kirchhoff's, for a parabolic lens.

    Accuracy  a bound while the result is below one; at 20 % it is a fifth above the true error.
    """
    beyond = _image(focal_length, distance)
    positive(wavelength=wavelength, radius=radius)
    defect = 2 * math.pi / wavelength * radius**4 / 8 * (beyond**-3 + distance**-3)
    return 4 / 45 * defect**2 + radius**2 * (beyond**-2 + distance**-2)


def _image(focal_length: float, distance: float) -> float:
    positive(focal_length=focal_length)
    if not distance > focal_length:
        raise Refused(
            "distance must be beyond the focal length, where a real image forms, got "
            f"{distance:g} m at a focal length of {focal_length:g} m"
        )
    return 1 / (1 / focal_length - 1 / distance)
