"""The Kirchhoff integral over a thin lens without paraxial approximation: the reference model.

    U(P'') = 1/(pi R^2) Int_lens  b^2 g^2 / (|r|^2 |r''|^2)  exp(i Phi) dxi deta
    Phi    = k (|r| - g) + k (|r''| - b) + lens

with r from the object and r'' to the image point, both obliquities n.r/|r| and both 1/|r|. It is
relative to the Fresnel amplitude in focus, pi R^2 / (lambda^2 b g): |U|^2 is 1 for a paraxial lens.

Source: Krutz et al. (2011), eqs. (7) and (9), in which the sign of the lens and the square
of eta are corrected.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Refused, finite, kernel, one_of, positive, whole

Complex = NDArray[np.complex128]

NODE, WEIGHT = np.polynomial.legendre.leggauss(16)
PANEL = 2 * math.pi  # radian of phase in one panel of 16 nodes: error 1e-13
MOST_EVALUATIONS = (
    400_000_000  # evaluations of the integrand that one call may take: some ten seconds
)


@dataclass(frozen=True)
class ThinLens:
    """A lens in one plane, its aperture, and an object on the axis.

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
        """Metre from the lens to the image."""
        return 1 / (1 / self.focal_length - 1 / self.distance)

    @property
    def wavenumber(self) -> float:
        """Radian per metre."""
        return 2 * math.pi / self.wavelength

    def phase_defect(self, radius: Floats) -> Floats:
        """Radian, of a ray at `radius` metre from the axis against the one through the centre."""
        square = np.square(radius)
        return self.wavenumber * _path(self, self.image, square)


def on_axis(lens: ThinLens, defocus: float = 0.0) -> complex:
    """The amplitude on the axis, eq. (9).

    defocus  metre by which the plane lies behind the image
    Raises    ValueError where it needs more than 4e8 evaluations.
    Accuracy  numerical: 1e-12 relative. The effort is 16 evaluations per wave of phase.
    """
    plane = _plane(lens, defocus)
    edges = _equal_phase(lens, plane, 0.0)
    u, weight = _panels(edges)
    square = u * lens.radius**2
    return complex(weight @ _integrand(lens, plane, square))


def profile(lens: ThinLens, radius: Floats, defocus: float = 0.0) -> Complex:
    """The amplitude off the axis, eq. (7), for an object on it.

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


def path_defect(square: Floats, image: float, distance: float) -> Floats:
    """Metre of path through a parabolic lens, at radius^2, beyond that through its centre.

    sqrt(b^2 + s) - b - s/(2b) = -s^2 / (2 b (sqrt(b^2 + s) + b)^2): no digits are lost.
    """
    path = -(square**2) / (2 * image * (np.sqrt(image**2 + square) + image) ** 2)
    if math.isfinite(distance):
        path = path - square**2 / (2 * distance * (np.sqrt(distance**2 + square) + distance) ** 2)
    return path


def _plane(lens: ThinLens, defocus: float) -> float:
    """Metre from the lens to the plane of the result."""
    finite(defocus=defocus)
    if lens.image + defocus <= 0:
        raise Refused(
            f"defocus must leave the plane behind the lens, whose image is at {lens.image:g} m, "
            f"got {defocus:g} m"
        )
    return lens.image + defocus


def _path(lens: ThinLens, plane: float, square: Floats) -> Floats:
    """Metre, of the ray through the lens at radius^2 to the point on the axis of a plane."""
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
    radius: Floats, r: Floats, amplitude: NDArray[np.complex128], cosine: Floats, plane: float,
    wavenumber: float,
) -> Any:  # fmt: skip
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
