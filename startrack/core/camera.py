"""Direction to pixel and pixel to direction, both ways together, with OpenCV's distortion."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from itertools import zip_longest

import numpy as np

from startrack.core.arrays import Flags, Floats
from startrack.core.checks import Refused, finite
from startrack.core.declared import FINITE, POSITIVE, Parameters, Range, parameter
from startrack.core.interpolation import Displacement, node_places
from startrack.core.kernel import kernel
from startrack.core.units import ZERO_CELSIUS, Unit

ORDER = 3
SMALL_ANGLE = 1e-6  # radian, below which the cosine has fewer than four digits of the angle
TERMS = 10  # monomials of two variables up to the third order
ROOM = ZERO_CELSIUS + 20.0  # kelvin


COEFFICIENTS = "coefficients of m; those that are left out at the end are 0"


class FieldPolynomial(Parameters):
    """A polynomial over the field, to the third order, that grows linearly with temperature.

        u' = u + sum_j (x_j + (T - T0) x_per_kelvin_j) m_j(u, v)
        v' = v + sum_j (y_j + (T - T0) y_per_kelvin_j) m_j(u, v)
        m  = 1, u, v, u^2, uv, v^2, u^3, u^2 v, u v^2, v^3

    with u = x / z and v = y / z of a direction in camera axes. OpenCV's distortion is added to it.

    Source: the form is that of the calibration of Chandra's aspect camera, which goes from pixels
    to angles (chandra_aca, transform.py); this one goes from directions to pixels.
    """

    x: tuple[float, ...] = parameter(COEFFICIENTS, default=())
    y: tuple[float, ...] = parameter(COEFFICIENTS, default=())
    x_per_kelvin: tuple[float, ...] = parameter("growth of these coefficients", default=())
    y_per_kelvin: tuple[float, ...] = parameter("growth of these coefficients", default=())
    temperature: float = parameter(
        "T, that the camera has",
        unit=Unit("K", "degC", absolute=True),
        limit=Range(1, 1000),
        default=ROOM,
    )
    reference: float = parameter(
        "T0, to which x and y belong",
        unit=Unit("K", "degC", absolute=True),
        limit=Range(1, 1000),
        default=ROOM,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("x", "y", "x_per_kelvin", "y_per_kelvin"):
            values = getattr(self, name)
            if len(values) > TERMS:
                raise Refused(
                    f"{name} must have at most {TERMS} coefficients, those of the third order, "
                    f"got {len(values)}"
                )
            finite(**{f"{name}[{n}]": value for n, value in enumerate(values)})

    def at(self, temperature: float) -> FieldPolynomial:
        """The same polynomial at another temperature, kelvin."""
        return replace(self, temperature=temperature)

    def plus(self, other: FieldPolynomial) -> FieldPolynomial:
        """The sum with another polynomial; growth and temperatures are those of the other one."""
        x, y = (
            tuple(a + b for a, b in zip_longest(*pair, fillvalue=0.0))
            for pair in ((self.x, other.x), (self.y, other.y))
        )
        return replace(other, x=x, y=y)

    def shift(self, plane: Floats, temperature: Floats | None = None) -> Floats:
        """Displacement of places.

        plane        (n, 2) u and v
        temperature  (n,) kelvin of each; None: that of the camera
        Returns      (n, 2)
        """
        terms = monomials(plane)
        warmer = (self.temperature if temperature is None else temperature) - self.reference
        parts = ((self.x, self.x_per_kelvin), (self.y, self.y_per_kelvin))
        return np.column_stack(
            [_sum(terms, fixed) + warmer * _sum(terms, growing) for fixed, growing in parts]
        )


def monomials(plane: Floats) -> Floats:
    """The monomials (n, TERMS) of places (n, 2)."""
    u, v = np.asarray(plane, float).T
    return np.column_stack([u ** (d - k) * v**k for d in range(ORDER + 1) for k in range(d + 1)])


def _sum(terms: Floats, coefficients: tuple[float, ...]) -> Floats:
    return np.asarray(terms[:, : len(coefficients)] @ np.asarray(coefficients, float))


# Steps of the inverse of a polynomial: each multiplies the error by the slope of the polynomial, so
# that one of a third converges.
MOST_STEPS = 60
FITTED = 33  # places along each side, to which a polynomial is fitted
SMALLEST_STEP = 1e-15  # of the plane
ROUNDS = 100  # of the inverse of a distortion, at most
LEAST_STEP = 1e-15  # at which its last digit no longer changes
STEPS = 3  # of the inverse of a residual; each reduces the error 100 times; by hand


COEFFICIENT = "OpenCV's distortion coefficients"


class Camera(Parameters):
    """A pinhole with radial and tangential distortion.

        x / z, y / z  ->  distorted (OpenCV)  ->  pixel = principal point + focal length * distorted

    With a polynomial over the field, its shift is added to the distorted point.

    Camera axes: +z boresight, +x to larger columns, +y to larger rows. The centre of the first
    pixel is (0, 0), so the centre of the array is ((columns - 1) / 2, (rows - 1) / 2).
    """

    columns: int = parameter("pixel", limit=Range(1, 2**20))
    rows: int = parameter("pixel", limit=Range(1, 2**20))
    focal_length_px: float = parameter("pixel", limit=POSITIVE)
    principal_x: float = parameter("pixel from the centre of the array", limit=FINITE, default=0.0)
    principal_y: float = parameter("pixel from the centre of the array", limit=FINITE, default=0.0)
    k1: float = parameter(COEFFICIENT, limit=FINITE, default=0.0)
    k2: float = parameter(COEFFICIENT, limit=FINITE, default=0.0)
    p1: float = parameter(COEFFICIENT, limit=FINITE, default=0.0)
    p2: float = parameter(COEFFICIENT, limit=FINITE, default=0.0)
    k3: float = parameter(COEFFICIENT, limit=FINITE, default=0.0)
    polynomial: FieldPolynomial | None = parameter(
        "over the field, as `calibrate` fits it to a table of stars; None: none", default=None
    )
    residual: Displacement | None = parameter(
        "displacement by which places differ from this model; None: nowhere", default=None
    )

    @classmethod
    def from_field_of_view(cls, columns: int, rows: int, fov_x: float) -> Camera:
        """The undistorted camera whose columns span `fov_x` radian, edge to edge."""
        if not 0 < fov_x < math.pi:
            raise Refused(f"fov_x must lie in (0, pi) radian, got {fov_x}")
        return cls(columns, rows, columns / 2 / math.tan(fov_x / 2))

    @property
    def centre(self) -> tuple[float, float]:
        """Pixel (x, y) of the principal point."""
        return (self.columns - 1) / 2 + self.principal_x, (self.rows - 1) / 2 + self.principal_y

    @property
    def distorted(self) -> bool:
        """Whether any distortion coefficient is not zero, or there is a polynomial."""
        bent = any((self.k1, self.k2, self.p1, self.p2, self.k3))
        return bent or self.polynomial is not None

    @property
    def fov_x(self) -> float:
        """Radian, angle that the columns span edge to edge, distortion left out."""
        return 2 * math.atan(self.columns / 2 / self.focal_length_px)

    @property
    def fov_y(self) -> float:
        """Radian, angle that the rows span edge to edge, distortion left out."""
        return 2 * math.atan(self.rows / 2 / self.focal_length_px)

    @cached_property
    def half_diagonal(self) -> float:
        """Radian, from the boresight to the farthest corner."""
        corners = [(x, y) for x in (-0.5, self.columns - 0.5) for y in (-0.5, self.rows - 0.5)]
        directions = self.unproject(np.array(corners))
        angle = float(np.arccos(directions[:, 2].min()))
        if angle > SMALL_ANGLE:
            return angle
        return float(np.hypot(directions[:, 0], directions[:, 1]).max())  # it is its own sine

    def lattice(self, count: int) -> Floats:
        """Directions of places evenly spaced from the first pixel's centre to the last's.

        count    places along each side
        Returns  (count^2, 3) unit vectors in camera axes, row by row
        """
        x = np.linspace(0, self.columns - 1, count)
        y = np.linspace(0, self.rows - 1, count)
        return self.unproject(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))

    def scaled(self, factor: float) -> Camera:
        """The same camera with another focal length, the only value that is checked again."""
        focal_length = self.focal_length_px * factor
        if not 0 < focal_length < math.inf:
            return replace(self, focal_length_px=focal_length)  # which raises the error
        camera = object.__new__(type(self))
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        vars(camera).update(values, focal_length_px=focal_length)
        return camera

    def project(self, direction: Floats) -> Floats:
        """Pixels on which directions fall.

        direction  (n, 3) in camera axes, of any length
        Returns    (n, 2) pixel (x, y); NaN for directions behind the camera
        Accuracy   numerical: 1e-12 of the array's width.
        """
        direction = np.atleast_2d(np.ascontiguousarray(direction, float))
        pixel = self._model(direction)
        return pixel if self.residual is None else pixel + self.residual(pixel)

    @property
    def ideal(self) -> Camera:
        """The camera without its residual, as a model with these parameters."""
        return self if self.residual is None else replace(self, residual=None)

    @property
    def as_polynomial(self) -> Camera:
        """The camera whose polynomial over the field is nearest to this one's distortion.

        A least-squares fit over the frame: the result of a noise-free calibration to the third
        order in x and y.
        """
        pixel = node_places(self.columns, self.rows, FITTED)
        direction = self.unproject(pixel)
        plane = direction[:, :2] / direction[:, 2:]
        away = (pixel - self.centre) / self.focal_length_px - plane
        # In units of the corner, so that all powers are of one size.
        size = float(np.abs(plane).max())
        solution = np.linalg.lstsq(monomials(plane / size), away, rcond=None)[0]
        x, y = (solution / monomials(np.full((1, 2), size)).T).T
        polynomial = FieldPolynomial(tuple(x.tolist()), tuple(y.tolist()))
        return Camera(
            self.columns,
            self.rows,
            self.focal_length_px,
            self.principal_x,
            self.principal_y,
            polynomial=polynomial,
        )

    def _model(self, direction: Floats) -> Floats:
        if not self.distorted:
            return np.asarray(_pinhole(direction, self.focal_length_px, *self.centre))
        plane = _pinhole(direction, 1.0, 0.0, 0.0)
        if self.polynomial is not None:
            shift = self.polynomial.shift(plane) * self.focal_length_px
            return replace(self, polynomial=None, residual=None).project(direction) + shift
        plane = _distorted(plane, self.k1, self.k2, self.p1, self.p2, self.k3)
        return plane * self.focal_length_px + self.centre

    def unproject(self, pixel: Floats) -> Floats:
        """Directions that fall on these pixels.

        pixel    (n, 2) pixel (x, y)
        Returns  (n, 3) unit vectors in camera axes
        Accuracy  numerical: 1e-9 pixel, if the distortion can be inverted and the slope of the
                  polynomial is at most a third.
        """
        pixel = np.atleast_2d(np.asarray(pixel, float))
        if self.residual is not None:
            displaced, pixel = pixel, pixel - self.residual(pixel)
            for _ in range(STEPS):
                pixel = displaced - self.residual(pixel)
        if self.polynomial is not None:
            return self._without_polynomial(pixel, self.polynomial)
        plane = (pixel - self.centre) / self.focal_length_px
        if self.distorted:
            plane = _undistorted(plane, self.k1, self.k2, self.p1, self.p2, self.k3)
        direction = np.column_stack([plane, np.ones(len(plane))])
        return direction / np.linalg.norm(direction, axis=1, keepdims=True)

    def _without_polynomial(self, pixel: Floats, polynomial: FieldPolynomial) -> Floats:
        """Fixed point of the direction of the pixel minus the shift at that direction."""
        plain = replace(self, polynomial=None, residual=None)
        plane = np.zeros((len(pixel), 2))
        direction = np.empty((len(pixel), 3))
        for _ in range(MOST_STEPS):
            direction = plain.unproject(pixel - polynomial.shift(plane) * self.focal_length_px)
            before, plane = plane, direction[:, :2] / direction[:, 2:]
            if not np.abs(plane - before).max(initial=0.0) > SMALLEST_STEP:
                break
        return direction

    def holds(self, pixel: Floats, margin: float = 0.0) -> Flags:
        """Pixels (n, 2) that lie on the array, or at most `margin` pixel outside."""
        x, y = np.asarray(pixel, float).T
        return (
            (x >= -0.5 - margin)
            & (x <= self.columns - 0.5 + margin)
            & (y >= -0.5 - margin)
            & (y <= self.rows - 0.5 + margin)
        )


@kernel
def _pinhole(direction: Floats, focal: float, x: float, y: float) -> Floats:
    """Pixels (n, 2); NaN for directions behind the camera."""
    pixel = np.empty((len(direction), 2))
    for k in range(len(direction)):
        pixel[k, 0], pixel[k, 1] = np.nan, np.nan
        if direction[k, 2] > 0:
            pixel[k, 0] = direction[k, 0] / direction[k, 2] * focal + x
            pixel[k, 1] = direction[k, 1] / direction[k, 2] * focal + y
    return pixel


@kernel
def _distorted(plane: Floats, k1: float, k2: float, p1: float, p2: float, k3: float) -> Floats:
    """`distort` of points (n, 2)."""
    bent = np.empty_like(plane)
    for n in range(len(plane)):
        bent[n, 0], bent[n, 1] = distort(plane[n, 0], plane[n, 1], k1, k2, p1, p2, k3)
    return bent


@kernel
def _undistorted(
    distorted: Floats, k1: float, k2: float, p1: float, p2: float, k3: float
) -> Floats:
    """The points (n, 2) that `distort` maps to these, by OpenCV's iteration until it converges."""
    plane = distorted.copy()
    for _ in range(ROUNDS):
        most_x = most_y = 0.0
        for n in range(len(plane)):
            start_x, start_y = distorted[n]
            x, y = plane[n]
            r2 = x * x + y * y
            radial = 1 + ((k3 * r2 + k2) * r2 + k1) * r2
            off_x = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
            off_y = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
            # Beyond the turning point of the distortion there is no inverse; OpenCV's answer.
            plane[n, 0], plane[n, 1] = start_x, start_y
            if radial > 0:
                plane[n, 0], plane[n, 1] = (start_x - off_x) / radial, (start_y - off_y) / radial
            most_x, most_y = max(most_x, abs(plane[n, 0] - x)), max(most_y, abs(plane[n, 1] - y))
        if not most_x + most_y > LEAST_STEP:
            break
    return plane


@kernel(inline="always")
def distort(
    x: float, y: float, k1: float, k2: float, p1: float, p2: float, k3: float
) -> tuple[float, float]:
    """OpenCV's distortion of a point x / z, y / z, for compiled code; `distort.py_func` for arrays.

        r^2 = x^2 + y^2,   x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)

    and y' likewise with x and y, p1 and p2 exchanged.

    Source: OpenCV, Camera calibration and 3D reconstruction, detailed description.
    """
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return u, v


@kernel(inline="always")
def plane_slopes(x, y):  # type: ignore[no-untyped-def]
    """Derivatives of x / z and y / z of a direction by a small rotation about the camera's axes.

        d(x / z) = (-x y, 1 + x^2, -y) . d,   d(y / z) = (-(1 + y^2), x y, x) . d

    x, y     1, the point in the image plane
    Returns  two tuples of three, 1
    """
    return (-x * y, 1 + x * x, -y), (-1 - y * y, x * y, x)
