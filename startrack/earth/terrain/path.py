"""The path of a straight ray over a grid, near one of its points: quadratic in the distance."""

import math
from typing import NamedTuple

from startrack.core import kernel
from startrack.earth.terrain.ellipsoid import ECCENTRICITY_2, EQUATORIAL
from startrack.earth.terrain.surface import Lattice, locate

# metre, or fraction of a cell if smaller: largest deviation of a path from its ray
TOLERANCE = 1e-2
LONGEST = 0.125  # largest half length of a path over the distance from the Earth's axis


class Ray(NamedTuple):
    """One ray: its origin in metres and its unit direction, in the Earth's fixed axes."""

    x: float
    y: float
    z: float
    dx: float
    dy: float
    dz: float


@kernel(forceinline=True)
def point_at(ray: Ray, s: float) -> tuple[float, float, float]:
    """The point of a ray at the distance `s`, metre."""
    return ray.x + s * ray.dx, ray.y + s * ray.dy, ray.z + s * ray.dz


class Path(NamedTuple):
    """The path at a distance s from its middle: each of u, v, h is q0 + q1 s + q2 s^2.

    u, v    columns and rows from the vertex [0, 0]
    h       metre above the ellipsoid
    sine    sine of the latitude at the middle
    cosine  cosine of the latitude at the middle
    """

    u0: float
    u1: float
    u2: float
    v0: float
    v1: float
    v2: float
    h0: float
    h1: float
    h2: float
    sine: float
    cosine: float


@kernel(forceinline=True)
def reach(lines: Lattice, ray: Ray, s: float, longest: float) -> tuple[float, float]:
    """Half the length up to which a quadratic path keeps its tolerance, and its height margin.

    The third derivatives of the path, in metres, stay below 8 c / p^2; c is the horizontal part of
    the direction, p the distance from the axis. They are 3 sin(e) cos^2(e) / r^2 for the height, 6
    c / r^2 for the latitude, and 6 c / p^2 for the longitude. Taylor's remainder gives the length.

    Returns  half the length, metre; bound of the error of height above the terrain at the ends,
             metre
    """
    x, y, z = point_at(ray, s)
    across_2 = x * x + y * y
    across_2 = across_2 if across_2 > 1e-6 else 1e-6
    across = math.sqrt(across_2)
    along = x * ray.dx + y * ray.dy + z * ray.dz
    level_2 = 1 - along * along / (across_2 + z * z)
    level = math.sqrt(level_2 if level_2 > 0 else 0.0) + 0.005  # grows along the ray
    width, depth = across / lines.per_column, EQUATORIAL / lines.per_row
    cell = width if width < depth else depth
    tolerance = TOLERANCE * (cell if cell < 1 else 1.0)
    half = _cube_root(6 * tolerance * across_2 / (8 * level))
    length = half if half < LONGEST * across else LONGEST * across
    half = length if length < longest else longest
    fraction = half / length
    margin = tolerance + (lines.highest - lines.lowest) * 2 * tolerance / cell
    return half, margin * fraction * fraction * fraction


@kernel(forceinline=True)
def _cube_root(volume: float) -> float:
    """Lower bound of the cube root above 1: 1/3 = 1/4 + 1/16 + ...; 12 % low at 1e11."""
    first = math.sqrt(math.sqrt(volume))
    second = math.sqrt(math.sqrt(first))
    return first * second * math.sqrt(math.sqrt(second))


@kernel(forceinline=True)
def path_at(lines: Lattice, ray: Ray, s: float) -> Path:
    """The path around a point, with derivatives from the rotation of the local axes.

    With e, n, w the parts of the direction to the east, to the north and upwards:
        lon' = e / p,  lat' = n / (M + h),  h' = w,  p' = cos(lat) w - sin(lat) n
        e' = lon' (sin(lat) n - cos(lat) w),  n' = -lat' w - lon' sin(lat) e,
        w' = lat' n + lon' cos(lat) e
    """
    x, y, z = point_at(ray, s)
    dx, dy, dz = ray.dx, ray.dy, ray.dz
    u, v, height, sine, cosine, across = locate(lines, x, y, z)
    across = across if across > 1e-3 else 1e-3
    per_across = 1 / across
    radial = (x * dx + y * dy) * per_across
    east = (x * dy - y * dx) * per_across
    north = cosine * dz - sine * radial
    rise = sine * dz + cosine * radial
    per_bend = 1 / (1 - ECCENTRICITY_2 * sine * sine)
    meridian = EQUATORIAL * (1 - ECCENTRICITY_2) * per_bend * math.sqrt(per_bend)
    per_radius = 1 / (meridian + height)
    turn, climb = east * per_across, north * per_radius
    growth = 3 * ECCENTRICITY_2 * meridian * sine * cosine * per_bend * climb + rise
    turn_2 = (turn * (sine * north - cosine * rise) - turn * radial) * per_across
    climb_2 = (-climb * rise - turn * sine * east - climb * growth) * per_radius
    rise_2 = climb * north + turn * cosine * east
    return Path(
        u,
        turn * lines.per_column,
        0.5 * turn_2 * lines.per_column,
        v,
        -climb * lines.per_row,
        -0.5 * climb_2 * lines.per_row,
        height,
        rise,
        0.5 * rise_2,
        sine,
        cosine,
    )


@kernel
def crossing(q0: float, q1: float, q2: float, sign: int, target: float) -> float:
    """Point at which a quadratic reaches `target` on its branch that rises (sign 1) or falls (-1).

    A reverted series, accurate to 1e-16, is used where the quadratic is nearly straight. Infinity
    where the quadratic does not reach the target.
    """
    rest = target - q0
    slow = q1 * q1
    bend = q2 * rest
    if abs(bend) < 5e-4 * slow and sign * q1 > 0:
        bend /= slow
        return rest / q1 * (1 - bend * (1 - bend * (2 - bend * (5 - bend * 14))))
    root = slow + 4 * bend
    if root < 0:
        return math.inf
    root = math.sqrt(root)
    if sign * q1 > 0:
        return 2 * rest / (q1 + sign * root)
    if q2 == 0:
        return math.inf
    return (sign * root - q1) / (2 * q2)
