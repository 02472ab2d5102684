"""Equations of Krutz et al. (2011) outside designs, as references for the models of designs.

Equations (7) and (9) without paraxial approximation, the Kirchhoff integral over a thin lens:

    U(P'') = 1/(pi R^2) Int_lens  b^2 g^2 / (|r|^2 |r''|^2)  exp(i Phi) dxi deta
    Phi    = k (|r| - g) + k (|r''| - b) + lens

r is from the object, r'' to the image point; both obliquities n.r/|r| and both 1/|r| are included.
U is relative to the Fresnel amplitude in focus, pi R^2 / (lambda^2 b g): |U|^2 is 1 for a paraxial
lens. The sign of the lens and the square of eta are corrected (docs/departures.md). Further:
Fresnel's amplitude in any plane, its range of validity (11), Gaussian images (12), and the time
density of a path (14).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from startrack import Refused
from startrack.core import Floats, finite, kernel, one_of, positive, whole
from startrack.motion import transfer
from startrack.optics import path_defect

Complex = NDArray[np.complex128]

NODE, WEIGHT = np.polynomial.legendre.leggauss(16)
PANEL = 2 * math.pi  # radian of phase in one panel of 16 nodes: error 1e-13
# largest number of evaluations of the integrand in a call: some ten seconds
MOST_EVALUATIONS = 400_000_000


@dataclass(frozen=True)
class ThinLens:
    """A thin lens, its aperture, and an object on the axis.

    focal_length  metre
    radius        metre, of the aperture
    distance      metre from the object to the lens; infinity for a star
    wavelength    metre
    lens          "parabolic": phase -pi r^2 / (lambda f), the paper's;
                  "perfect": the phase of a spherical wave that converges on the image
    """

    focal_length: float
    radius: float
    distance: float
    wavelength: float
    lens: str = "parabolic"

    def __post_init__(self) -> None:
        positive(focal_length=self.focal_length, radius=self.radius, wavelength=self.wavelength)
        if not self.distance > self.focal_length:
            raise Refused(
                "distance must be beyond the focal length, where a real image forms, got "
                f"{self.distance:g} m at a focal length of {self.focal_length:g} m"
            )
        one_of(("parabolic", "perfect"), lens=self.lens)

    @property
    def image(self) -> float:
        """Distance from the lens to the image, metre."""
        return 1 / (1 / self.focal_length - 1 / self.distance)

    @property
    def wavenumber(self) -> float:
        """Wave number, radian / metre."""
        return 2 * math.pi / self.wavelength

    def phase_defect(self, radius: Floats) -> Floats:
        """Phase of a ray at `radius` metre from the axis relative to the ray through the centre,
        radian."""
        square = np.square(radius)
        return self.wavenumber * _path(self, self.image, square)


def on_axis(lens: ThinLens, defocus: float = 0.0) -> complex:
    """The amplitude on the axis, eq. (9).

    defocus  metre, distance of the plane behind the image
    Raises    ValueError where it needs more than 4e8 evaluations.
    Accuracy  numerical: 1e-12 relative. The effort is 16 evaluations per wave of phase.
    """
    plane = _plane(lens, defocus)
    edges = _equal_phase(lens, plane, 0.0)
    u, weight = _panels(edges)
    square = u * lens.radius**2
    return complex(weight @ _integrand(lens, plane, square))


def profile(lens: ThinLens, radius: Floats, defocus: float = 0.0) -> Complex:
    """The amplitude off the axis, eq. (7), for an object on the axis.

    radius   (n,) metre from the axis, in the plane of the image
    Returns  (n,) relative amplitude, its phase relative to the point on the axis
    Raises    ValueError where it needs more than 4e8 evaluations.
    Accuracy  numerical: 1e-10 of the peak. Panels in r^2 follow the phase; the angle is a periodic
              trapezoid, which converges faster than any power.
    """
    radius = np.asarray(radius, float)
    if not np.isfinite(radius).all():
        raise Refused(f"radius must be finite, got {radius[~np.isfinite(radius)][0]}")
    plane = _plane(lens, defocus)
    far = float(np.abs(radius).max(initial=0.0))
    u, weight = _panels(_equal_phase(lens, plane, far))
    turns = lens.wavenumber * far * lens.radius / math.hypot(plane, lens.radius)
    angles = 2 * math.ceil(turns / 2 + 12)
    _limit_effort(len(u) * angles * len(radius))
    r = lens.radius * np.sqrt(u)
    amplitude = weight * _integrand(lens, plane, r * r)
    cosine = np.cos((np.arange(angles) + 0.5) * (math.pi / angles))
    return _off_axis(radius, r, amplitude, cosine, plane, lens.wavenumber)


def point(lens: ThinLens, image: Floats, source: Floats, samples: int) -> complex:
    """The amplitude for an object and an image point both off the axis, eq. (7) in full.

    image    (2,) metre, (x'', y'') in the plane of the image
    source   (2,) metre, (x', y') in the plane of the object, whose distance is finite
    samples  along the radius; angles are three times as many
    Accuracy  numerical: exponential in `samples` above two per wave. For an object on the axis,
              `profile` is faster.
    """
    whole(1, 10_000, samples=samples)
    if not math.isfinite(lens.distance):
        raise Refused("distance must be finite for an object off the axis, got inf")
    node, weight = np.polynomial.legendre.leggauss(samples)
    r = lens.radius * np.sqrt((node + 1) / 2)[:, None]
    angle = np.arange(3 * samples) * (2 * math.pi / (3 * samples))
    xi, eta = r * np.cos(angle), r * np.sin(angle)
    b, g, square = lens.image, lens.distance, r * r
    # |r| - g without cancellation: (|r|^2 - g^2) / (|r| + g).
    to_source = square - 2 * (xi * source[0] + eta * source[1]) + float(source @ source)
    to_image = square - 2 * (xi * image[0] + eta * image[1]) + float(image @ image)
    path = to_source / (np.sqrt(g * g + to_source) + g) + to_image / (np.sqrt(b * b + to_image) + b)
    if lens.lens == "parabolic":
        path = path - square / (2 * lens.focal_length)
    else:
        path = (
            path - square / (np.sqrt(g * g + square) + g) - square / (np.sqrt(b * b + square) + b)
        )
    value = np.exp(1j * lens.wavenumber * path)
    value *= (g * g / (g * g + to_source)) * (b * b / (b * b + to_image))
    return complex((weight / 2) @ value.mean(axis=1))


def _plane(lens: ThinLens, defocus: float) -> float:
    """Distance from the lens to the plane of the result, metre."""
    finite(defocus=defocus)
    if lens.image + defocus <= 0:
        raise Refused(
            f"defocus must leave the plane behind the lens, whose image is at {lens.image:g} m, "
            f"got {defocus:g} m"
        )
    return lens.image + defocus


def _path(lens: ThinLens, plane: float, square: Floats) -> Floats:
    """Length of the ray through the lens at radius^2 to the axial point of a plane, metre."""
    if lens.lens == "parabolic":
        path = path_defect(square, lens.image, lens.distance)
    else:
        path = np.zeros_like(square)
    if plane != lens.image:
        b = lens.image
        path = path + square / (np.sqrt(plane**2 + square) + plane)
        path = path - square / (np.sqrt(b**2 + square) + b)
    return path


def _integrand(lens: ThinLens, plane: float, square: Floats) -> Complex:
    b, g = lens.image, lens.distance
    obliquity = b**2 / (plane**2 + square)
    if math.isfinite(g):
        obliquity = obliquity * (g**2 / (g**2 + square))
    return obliquity * np.exp(1j * lens.wavenumber * _path(lens, plane, square))


def _equal_phase(lens: ThinLens, plane: float, far: float) -> Floats:
    """Edges of panels in u = (r / R)^2 with at most PANEL of phase each."""
    u = np.linspace(0, 1, 4097)
    phase = lens.wavenumber * _path(lens, plane, u * lens.radius**2)
    # Off the axis the linear phase k rho r / b is added, which is steep in u near the centre.
    steep = lens.wavenumber * far * lens.radius / plane
    total = np.cumsum(np.r_[0.0, np.abs(np.diff(phase))]) + steep * np.sqrt(u)
    count = math.ceil(total[-1] / PANEL) + 1
    _limit_effort(16 * count)
    return np.interp(np.linspace(0, total[-1], count + 1), total, u) if total[-1] else u[[0, -1]]


def _panels(edges: Floats) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss-Legendre rules between edges."""
    half = np.diff(edges)[:, None] / 2
    middle = (edges[1:] + edges[:-1])[:, None] / 2
    return (middle + half * NODE).ravel(), (half * WEIGHT).ravel()


def _limit_effort(count: int) -> None:
    if count > MOST_EVALUATIONS:
        raise Refused(
            f"the Kirchhoff integral must take at most {MOST_EVALUATIONS:.0e} evaluations, got "
            f"{count:.1e}: take a smaller aperture, a smaller defocus or fewer points"
        )


@kernel
def _off_axis(
    radius: Floats,
    r: Floats,
    amplitude: NDArray[np.complex128],
    cosine: Floats,
    plane: float,
    wavenumber: float,
) -> Any:
    """Sum over the lens; half a turn is enough by symmetry."""
    result = np.empty(len(radius), np.complex128)
    for n in range(len(radius)):
        rho = radius[n]
        total = 0.0 + 0.0j
        for i in range(len(r)):
            central = plane * plane + r[i] * r[i]
            root = np.sqrt(central)
            ring_re, ring_im = 0.0, 0.0
            for j in range(len(cosine)):
                extra = rho * rho - 2 * rho * r[i] * cosine[j]
                path = extra / (np.sqrt(central + extra) + root)
                # `amplitude` contains the obliquity at the centre of the image.
                weight = central / (central + extra)
                ring_re += weight * np.cos(wavenumber * path)
                ring_im += weight * np.sin(wavenumber * path)
            total += amplitude[i] * complex(ring_re, ring_im)
        result[n] = total / len(cosine)
    return result


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

    Source: Krutz et al. (2011), eq. (11). Only for comparison with the paper: the zeros of both
    parts depend on the phase origin k (b + g), so that the radius is discontinuous when the path
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
    """The largest aperture with a spherical phase defect below a tolerance.

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

    Accuracy  a bound while the result is below one; at 20 % the bound is a fifth above the true
              error.
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


def density(time: Floats, offset: Floats, columns: int, rows: int, cell: float = 1.0) -> Floats:
    """The time density of a path, as fractions in the cells of a grid around its origin.

    This is the integral of eq. (14) of Krutz et al. (2011) over each cell. The printed equation
    divides by v_x, which is 0 at turning points, at rest and for motion along y; here time is
    summed.

    time     (m,) second, increasing
    offset   (m, 2) pixel, (x, y) at these times, joined by straight lines
    cell      pixel, side of a cell; the grid's centre is at offset (0, 0)
    Returns   (rows, columns) 1; its sum is the fraction of the time that the path is on the grid
    Raises    ValueError where there are fewer than two increasing times.
    Accuracy  numerical: second order in the distance of the times.
    """
    time, offset = np.asarray(time, float), np.asarray(offset, float)
    whole(1, 2**15, columns=columns, rows=rows)
    positive(cell=cell)
    if len(time) < 2 or not np.isfinite(time).all() or not (np.diff(time) > 0).all():
        raise Refused("time must hold two or more increasing, finite values")
    if offset.shape != (len(time), 2) or not np.isfinite(offset).all():
        raise Refused(
            f"offset must hold finite (x, y) for {len(time)} times, got shape {offset.shape}"
        )
    fraction = np.diff(time) / (time[-1] - time[0])
    image = np.zeros((rows, columns))
    # Cells as unit squares, the first from 0 to 1.
    x, y = (offset / cell + np.array([columns, rows]) / 2).T
    _deposit(image, np.ascontiguousarray(x), np.ascontiguousarray(y), fraction)
    return image


@kernel
def _deposit(image: Floats, x: Floats, y: Floats, fraction: Floats) -> None:
    """Add the time of each straight segment to the cells that it crosses."""
    for n in range(len(fraction)):
        dx, dy = x[n + 1] - x[n], y[n + 1] - y[n]
        # The segment runs from 0 to 1; next crossings of a column edge and of a row edge.
        step_x, step_y = abs(1 / dx), abs(1 / dy)
        next_x = _first(x[n], dx) * step_x if dx != 0 else np.inf
        next_y = _first(y[n], dy) * step_y if dy != 0 else np.inf
        done = 0.0
        while done < 1:
            end = min(next_x, next_y, 1.0)
            middle = (done + end) / 2
            column, row = int(np.floor(x[n] + middle * dx)), int(np.floor(y[n] + middle * dy))
            if 0 <= row < image.shape[0] and 0 <= column < image.shape[1]:
                image[row, column] += fraction[n] * (end - done)
            if next_x <= end:
                next_x += step_x
            if next_y <= end:
                next_y += step_y
            done = end


@kernel
def _first(position, velocity):  # type: ignore[no-untyped-def]
    """Distance to the first edge ahead, in (0, 1]."""
    if velocity > 0:
        return np.floor(position) + 1 - position
    return position - np.ceil(position) + 1


NYQUIST = 0.5  # cycles per pixel


def nyquist_mtf(offset: Floats, weight: Floats) -> tuple[float, float]:
    """The MTF at half a cycle per pixel, along x and along y; arguments as in `transfer`."""
    x, y = np.abs(transfer(offset, weight, np.diag([NYQUIST, NYQUIST]))).tolist()
    return x, y
