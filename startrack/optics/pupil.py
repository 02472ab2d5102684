"""Shape of the aperture, and the Zernike polynomials of wavefront errors in it."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy import special

from startrack.core import (
    FINITE,
    POSITIVE,
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
)

EDGE = 0.75  # cell, width of the soft edge: 3e-6 of the peak at twice the critical sampling
MARGIN = 3  # cells beyond the rim, where the soft edge is zero
SIDES = (math.pi / 6, math.pi / 2, 5 * math.pi / 6)  # radian, normals of a hexagon's sides
AREA_CELLS = 512  # across the aperture, for its open area: 1e-5 for shapes with corners


class Segment(Parameters):
    """One piece of a segmented or sparse aperture."""

    x: float = parameter("x of its centre, in radii of the whole aperture", limit=FINITE)
    y: float = parameter("y of its centre, in radii of the whole aperture", limit=FINITE)
    size: float = parameter(
        "radius of a circle, or half the distance between two opposite sides of a hexagon",
        limit=POSITIVE,
    )
    shape: str = parameter(
        '"circle" or "hexagon" (two of its sides along x)',
        limit=Range(choices=("circle", "hexagon")),
        default="hexagon",
    )
    piston: float = parameter(
        "additional path of its wavefront; a mirror moves by half of it",
        unit=Unit("m", "nm"),
        limit=FINITE,
        default=0.0,
    )
    tilt_x: float = parameter(
        "slope of its wavefront along x about its centre; a mirror rotates by half of it",
        unit=Unit("rad", "arcsec"),
        limit=Range(-0.1, 0.1),
        default=0.0,
    )
    tilt_y: float = parameter(
        "likewise along y", unit=Unit("rad", "arcsec"), limit=Range(-0.1, 0.1), default=0.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        radius = self.size * (1 if self.shape == "circle" else 2 / math.sqrt(3))
        if math.hypot(self.x, self.y) + radius > 1 + 1e-9:
            raise Refused(
                f"segment must lie inside the aperture of radius 1, got {self.shape} at "
                f"({self.x:g}, {self.y:g}) of size {self.size:g}"
            )

    def overlaps(self, other: Segment) -> bool:
        """Whether it overlaps another segment by more than rounding.

        They overlap if the centre of one lies inside the other segment enlarged by the first one's
        size. For a circle beside the corner of a hexagon, this is slightly too strict.
        """
        x, y = other.x - self.x, other.y - self.y
        if self.shape == other.shape == "circle":
            apart = math.hypot(x, y)
        else:
            apart = max(abs(x * math.cos(turn) + y * math.sin(turn)) for turn in SIDES)
        return apart < self.size + other.size - 1e-9


class Pupil(Parameters):
    """Shape of the aperture; the default is a clear circle."""

    obscuration: float = parameter(
        "radius of the central obscuration over the radius of the aperture",
        limit=Range(0, 0.95),
        default=0.0,
    )
    vanes: int = parameter(
        "number of evenly spaced arms that hold the obscuration", limit=Range(0, 32), default=0
    )
    vane_width: float = parameter(
        "width of an arm over the radius of the aperture", limit=Range(0, 0.5), default=0.0
    )
    vane_angle: float = parameter(
        "angle of the first arm, from +x towards +y",
        unit=Unit("rad", "deg"),
        limit=FINITE,
        default=0.0,
    )
    segments: tuple[Segment, ...] = parameter(
        "the pieces of a segmented or sparse aperture; none: the whole circle", default=()
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.vanes > 0) != (self.vane_width > 0):
            raise Refused(
                "vanes and vane_width must both be zero or both be positive, got "
                f"{self.vanes} and {self.vane_width}"
            )
        for segment, other in combinations(self.segments, 2):
            if segment.overlaps(other):
                raise Refused(f"segments must not overlap, got {segment} and {other}")

    @property
    def clear(self) -> bool:
        """Whether it is a clear circle."""
        return not (self.obscuration or self.vanes or self.segments)

    @property
    def fraction(self) -> float:
        """Open area over the area of the circle.

        Accuracy  numerical: 1e-5 for shapes with corners.
        """
        return 1.0 if self.clear else _open_fraction(self)

    @property
    def phased(self) -> bool:
        """Whether all segments form one wavefront, without piston and tilt."""
        return not any(one.piston or one.tilt_x or one.tilt_y for one in self.segments)


def nearest_segment(pupil: Pupil, x: Floats, y: Floats) -> Ints:
    """Number of the segment that is nearest to each point, by distance over size."""
    apart = [np.hypot(x - one.x, y - one.y) / one.size for one in pupil.segments]
    return np.argmin(apart, axis=0)


def segment_path(pupil: Pupil, x: Floats, y: Floats, radius: float) -> Floats:
    """Path (metre) at each point, by piston and tilt of the nearest segment.

    x, y    1, in radii of the aperture, of shapes that broadcast
    radius  metre, of the aperture
    """
    each = [
        one.piston + radius * (one.tilt_x * (x - one.x) + one.tilt_y * (y - one.y))
        for one in pupil.segments
    ]
    number = nearest_segment(pupil, x, y)
    return np.take_along_axis(np.array(each), number[None], axis=0)[0]


@lru_cache(maxsize=64)
def _open_fraction(pupil: Pupil) -> float:
    x, cell = pupil_grid(AREA_CELLS)
    return float(area_weights(pupil, x, cell).sum()) * cell**2 / math.pi


def pupil_grid(count: int) -> tuple[Floats, float]:
    """The grid on which a pupil is sampled, symmetric about the axis.

    count    even, samples along a side
    Returns  (count,) 1, coordinates in radii of the aperture; 1, their spacing
    """
    cell = 2 / (count - 2 * MARGIN)
    return (np.arange(float(count)) - (count - 1) / 2) * cell, cell


def area_weights(pupil: Pupil, x: Floats, cell: float) -> Floats:
    """Quadrature weights of the open area on a grid: 1 inside, 0 outside, soft at the edges.

    A sharp mask makes a quadrature of first order. Here the mask is convolved with a kernel whose
    second and fourth moments are zero, so that the sum over the grid integrates a smooth function
    with an error of sixth order; the soft edge reaches three cells beyond the rim.

    x        (n,) 1, coordinates in radii of the aperture, for both axes
    cell     1, their spacing
    Returns  (n, n) 1, rows along y
    Accuracy  model: in corners, the product of two soft edges replaces the convolution: an area of
              a tenth of a squared cell per corner.
    """
    y = x[:, None]
    if pupil.segments:
        mask = np.zeros((len(x), len(x)))
        for segment in pupil.segments:
            mask += _segment(segment, x - segment.x, y - segment.y, cell)
    else:
        mask = soft_step((np.hypot(x, y) - 1) / cell)
    if pupil.obscuration:
        mask *= 1 - soft_step((np.hypot(x, y) - pupil.obscuration) / cell)
    for turn in pupil.vane_angle + np.arange(pupil.vanes) * (2 * np.pi / max(pupil.vanes, 1)):
        along = x * math.cos(turn) + y * math.sin(turn)
        across = y * math.cos(turn) - x * math.sin(turn)
        mask *= 1 - _strip(across, pupil.vane_width / 2, cell) * soft_step(-along / cell)
    return mask


def soft_step(distance: Floats) -> Floats:
    """Soft edge: one far inside (negative distance, in cells), zero far outside.

    It is the integral of a Gaussian of sigma EDGE times 1 - (D/2) + (D/2)^2/2, with D its second
    derivative in sigmas. Its transform exp(-t) (1 + t + t^2 / 2) is one up to t^3.
    """
    z = distance / EDGE
    bell = np.exp(-z * z / 2) / math.sqrt(2 * math.pi)
    return special.ndtr(-z) - bell * z * (7 - z * z) / 8


def _strip(across: Floats, half_width: float, cell: float) -> Floats:
    # The difference of two steps is the exact convolution, so a vane may be thinner than a cell.
    return soft_step((across - half_width) / cell) - soft_step((across + half_width) / cell)


def _segment(segment: Segment, x: Floats, y: Floats, cell: float) -> Floats:
    if segment.shape == "circle":
        return soft_step((np.hypot(x, y) - segment.size) / cell)
    mask = np.ones(np.broadcast_shapes(x.shape, y.shape))
    for turn in SIDES:
        mask *= _strip(x * math.cos(turn) + y * math.sin(turn), segment.size, cell)
    return mask


MOST = 231  # Noll index of the last mode with n = 20


class Aberration(Parameters):
    """One term of the wavefront error."""

    noll: int = parameter(
        "Noll's index: 4 defocus, 5 and 6 astigmatism, 7 and 8 coma, 11 spherical",
        limit=Range(1, MOST),
    )
    rms: float = parameter(
        "rms over the clear circular aperture (at the edge of the field if the term grows)",
        unit=Unit("m", "nm"),
        limit=FINITE,
    )
    growth: int = parameter(
        "power of the field angle with which it grows from the axis; 0: the same everywhere",
        limit=Range(0, 10),
        default=0,
    )


def noll_to_nm(noll: int) -> tuple[int, int]:
    """Radial order n and azimuthal order m of a Noll index; m < 0 for the sine.

    Source: Noll (1976), J. Opt. Soc. Am. 66, 207, table I.

    >>> [noll_to_nm(j) for j in (1, 2, 3, 4, 5, 6, 7, 8, 11)]
    [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (4, 0)]
    """
    n = (math.isqrt(8 * noll - 7) - 1) // 2
    rank = noll - n * (n + 1) // 2  # 1 ... n + 1 within the order
    m = 2 * (rank // 2) if n % 2 == 0 else 2 * ((rank - 1) // 2) + 1
    return n, m if noll % 2 == 0 else -m


def even_terms(last: int) -> list[int]:
    """Noll's indices from 2 to `last` of the terms that are even in y."""
    return [noll for noll in range(2, last + 1) if noll_to_nm(noll)[1] >= 0]


def zernike(noll: int, x: Floats, y: Floats) -> Floats:
    """A Zernike polynomial, of unit rms over the unit disk.

        Z = sqrt(n + 1) R_n^m(rho) {1, sqrt(2) cos(m theta), sqrt(2) sin(m theta)}
        R_n^m(rho) = (-1)^k rho^m P_k^(m, 0)(1 - 2 rho^2),  k = (n - m) / 2

    Source: Noll (1976), eqs. (1)-(3); the Jacobi polynomials keep R stable at high orders.

    x, y     (...) 1, in radii of the aperture; beyond the rim the polynomial is continued
    Returns  (...) 1
    """
    n, m = noll_to_nm(noll)
    order = abs(m)
    k = (n - order) // 2
    square = x * x + y * y
    radial = (-1) ** k * special.eval_jacobi(k, order, 0, 1 - 2 * square)
    # rho^m exp(i m theta) is a power of x + i y: no angle, which is undefined at the centre.
    power = (x + 1j * y) ** order
    turn = power.imag if m < 0 else power.real
    return math.sqrt((n + 1) * (2 if m else 1)) * radial * turn


def nm_to_noll(n: int, m: int) -> int:
    """Noll's index of radial order n and azimuthal order m; m < 0 for the sine.

    >>> all(nm_to_noll(*noll_to_nm(j)) == j for j in range(1, MOST + 1))
    True
    """
    first = n * (n + 1) // 2 + 1
    here = [noll for noll in range(first, first + n + 1) if noll_to_nm(noll) == (n, m)]
    if not here:
        raise Refused(f"m must be one of -n, -n + 2, ... n, got n = {n}, m = {m}")
    return here[0]
