"""Fraunhofer and Fresnel diffraction of any pupil, by fast transforms."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from startrack.core import Floats, Refused, kernel, positive, whole


def pupil_samples(half_width: float, slope: float = 0.0) -> int:
    """Number of samples across a pupil that its transform needs.

    half_width  1, half the width of the field over wavelength * f-number: cycles across the pupil
    slope       wave per radius, steepest slope of the wavefront
    Returns     1, even
    Accuracy    numerical: 3e-6 of the peak without aberrations, 1e-4 with a wavefront of this
                slope; it falls with the fifth power of the number of samples. The three constants
                were chosen by hand for these errors; tests/optics checks them.
    """
    return 2 * math.ceil(max(2.4 * half_width, 6 * slope) + 14)


def intensity(pupil: Floats, phase: Floats, coordinate: Floats, field: Floats) -> Floats:
    """The irradiance of a pupil, in its natural unit.

        |sum_ij pupil_ij exp(i phase_ij) exp(-i pi (x_i u + y_j v))|^2

    pupil       (n, n) 1, weights of the open area times amplitude, n even, rows along y
    phase       (n, n) radian
    coordinate  (n,) 1, of the samples in radii of the aperture; symmetric about zero
    field       (m,) 1, of the points over wavelength * f-number; symmetric about zero, m odd
    Returns     (m, m), rows along y
    Accuracy    numerical: 1e-13 of the peak, besides the sampling; see `pupil_samples`.
    """
    cosine, sine = _waves(coordinate.tobytes(), field.tobytes())
    parts = _fold(pupil, phase)
    half, width = len(coordinate) // 2, len(field) // 2 + 1
    # After the rows: [x even or odd][re, im] over (v, x). Then the columns.
    shape = (2, 2, width, width)
    even = (cosine @ parts[0]).reshape(width, 2, 2, half).transpose(1, 2, 0, 3)
    odd = (sine @ parts[1]).reshape(width, 2, 2, half).transpose(1, 2, 0, 3)
    by_cosine = np.stack([even[0], odd[0]]).reshape(-1, half) @ cosine.T
    by_sine = np.stack([even[1], odd[1]]).reshape(-1, half) @ sine.T
    return _unfold(by_cosine.reshape(shape), by_sine.reshape(shape))


@lru_cache(maxsize=32)
def _waves(coordinate: bytes, field: bytes) -> tuple[Floats, Floats]:
    """Cosines and sines between the positive halves of both grids: (m // 2 + 1, n // 2)."""
    x, u = np.frombuffer(coordinate), np.frombuffer(field)
    angle = np.pi * np.outer(u[len(u) // 2 :], x[len(x) // 2 :])
    return np.cos(angle), np.sin(angle)


@kernel(fastmath=True)
def _fold(pupil: Floats, phase: Floats) -> Floats:
    """Even and odd parts of the complex pupil, on the quarter x > 0, y > 0.

    parts[y odd] holds, side by side, [x even: re, im | x odd: re, im].
    """
    n = pupil.shape[0]
    half = n // 2
    parts = np.zeros((2, half, 4 * half))
    for j in range(half):
        for i in range(half):
            for above in range(2):
                row = half + j if above == 0 else half - 1 - j
                for side in range(2):
                    column = half + i if side == 0 else half - 1 - i
                    size = pupil[row, column]
                    if size == 0.0:
                        continue
                    re = size * np.cos(phase[row, column])
                    im = size * np.sin(phase[row, column])
                    across = 1.0 if side == 0 else -1.0
                    down = 1.0 if above == 0 else -1.0
                    parts[0, j, i] += re
                    parts[0, j, half + i] += im
                    parts[0, j, 2 * half + i] += across * re
                    parts[0, j, 3 * half + i] += across * im
                    parts[1, j, i] += down * re
                    parts[1, j, half + i] += down * im
                    parts[1, j, 2 * half + i] += down * across * re
                    parts[1, j, 3 * half + i] += down * across * im
    return parts


@kernel(fastmath=True)
def _unfold(by_cosine: Floats, by_sine: Floats) -> Floats:
    """|U|^2 on the whole field from its four parts on a quarter.

    by_cosine[0], by_sine[0]  even rows: cos cos and (odd columns) cos sin
    by_cosine[1], by_sine[1]  odd rows: sin cos and sin sin; first axis after that re, im
    """
    width = by_cosine.shape[2]
    m = 2 * width - 1
    result = np.empty((m, m))
    for j in range(width):
        for i in range(width):
            # exp(-i(a + b)) = cos cos - sin sin - i (sin cos + cos sin)
            cc_re, cc_im = by_cosine[0, 0, j, i], by_cosine[0, 1, j, i]
            ss_re, ss_im = by_sine[1, 0, j, i], by_sine[1, 1, j, i]
            sc_re, sc_im = by_cosine[1, 0, j, i], by_cosine[1, 1, j, i]
            cs_re, cs_im = by_sine[0, 0, j, i], by_sine[0, 1, j, i]
            for above in range(2):
                down = 1.0 if above == 0 else -1.0
                row = width - 1 + j if above == 0 else width - 1 - j
                for side in range(2):
                    across = 1.0 if side == 0 else -1.0
                    column = width - 1 + i if side == 0 else width - 1 - i
                    re = cc_re - down * across * ss_re + down * sc_im + across * cs_im
                    im = cc_im - down * across * ss_im - down * sc_re - across * cs_re
                    result[row, column] = re * re + im * im
    return result


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
