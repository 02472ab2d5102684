"""Exact points and normals where rays meet a surface, for bundles of rays."""

import math

import numpy as np

from startrack.core import Floats, Singles, kernel
from startrack.earth.terrain.ellipsoid import ECCENTRICITY_2, EQUATORIAL
from startrack.earth.terrain.march import RaySegment, above, entry_and_exit, segment_from
from startrack.earth.terrain.path import Path, Ray, path_at
from startrack.earth.terrain.surface import Lattice

POLISHED = 1e-9  # metre, last step of Newton's method at convergence
NEAR = 1.0  # metre; within it a path deviates from its ray by 1e-12 m, its vertical by 2e-7 radian
STEPS = 60  # of bisection in the worst case, which reduce 100 km to 1e-13 m


@kernel(forceinline=True)
def refine(
    lines: Lattice,
    ray: Ray,
    guess: float,
    j: int,
    i: int,
    corner: tuple[float, float, float, float],
) -> tuple[bool, float, float, float, float, float, float]:
    """Three steps of Newton's method in one cell, from a good estimate.

    j, i     row and column of the cell
    corner   four numbers, as for `corners`
    Returns  whether Newton's method converged; distance of the point; its column, row and height,
             sine and cosine of its latitude
    """
    a, b, c, d = corner
    path = path_at(lines, ray, guess)
    u0, v0 = path.u0 - i, path.v0 - j
    u0 = u0 - lines.turn * math.floor(u0 / lines.turn + 0.5)
    t = step = change = 0.0
    for _ in range(3):
        u, v = u0 + t * (path.u1 + t * path.u2), v0 + t * (path.v1 + t * path.v2)
        height = path.h0 + t * (path.h1 + t * path.h2)
        change = path.h1 + 2 * t * path.h2 - (b + d * v) * (path.u1 + 2 * t * path.u2)
        change = change - (c + d * u) * (path.v1 + 2 * t * path.v2)
        step = (a + b * u + (c + d * u) * v - height) / change
        t = t + step
    u, v = u0 + t * (path.u1 + t * path.u2), v0 + t * (path.v1 + t * path.v2)
    height = path.h0 + t * (path.h1 + t * path.h2)
    converged = (abs(step) < POLISHED) & (abs(t) < NEAR) & (change < 0)
    converged = converged & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    return converged, guess + t, u + i, v + j, height, path.sine, path.cosine


@kernel(borrows=True)
def settle(
    lines: Lattice,
    heights: Singles,
    ray: Ray,
    slot: int,
    j: int,
    i: int,
    low: float,
    high: float,
    s: float,
) -> tuple[float, tuple[float, float, float, float, float]]:
    """The point between two distances where the ray passes from above the surface to below.

    Newton's method within bounds; a new path is laid where a step leaves the old path.

    Returns  distance of the point; its column, row and height, sine and cosine of its latitude
    """
    base = s
    path = path_at(lines, ray, s)
    for _ in range(STEPS):
        value, change, twist = above(lines, heights, slot, j, i, path, s - base)
        if value > 0:
            low = s
        else:
            high = s
        step = -value / change
        if change < 0 and low <= s + step <= high:
            s += step
            if step * step * (twist + 1e-6) < -POLISHED * change:
                break
        else:
            s = 0.5 * (low + high)
            if high - low < POLISHED:
                break
        if abs(s - base) > NEAR:
            base = s
            path = path_at(lines, ray, s)
    t = s - base
    u, v = path.u0 + t * (path.u1 + t * path.u2), path.v0 + t * (path.v1 + t * path.v2)
    return s, (u, v, path.h0 + t * (path.h1 + t * path.h2), path.sine, path.cosine)


@kernel(forceinline=True)
def normal_at(
    lines: Lattice,
    x: float,
    y: float,
    height: float,
    sine: float,
    cosine: float,
    to_column: float,
    to_row: float,
) -> tuple[float, float, float]:
    """The normal of the surface at a point, from the slopes along columns and rows.

    normal ~ up - h_lon / ((N + h) cos(lat)) east - h_lat / (M + h) north
    """
    across = math.sqrt(x * x + y * y)
    per_across = 1 / (across if across > 1e-3 else 1e-3)
    per_bend = 1 / (1 - ECCENTRICITY_2 * sine * sine)
    meridian = EQUATORIAL * (1 - ECCENTRICITY_2) * per_bend * math.sqrt(per_bend)
    lean = -to_column * lines.per_column * per_across
    tilt = to_row * lines.per_row / (meridian + height)
    scale = 1 / math.sqrt(1 + lean * lean + tilt * tilt)
    cosine_x, sine_y = x * per_across, y * per_across
    radial = cosine - tilt * sine
    return (
        scale * (radial * cosine_x - lean * sine_y),
        scale * (radial * sine_y + lean * cosine_x),
        scale * (sine + tilt * cosine),
    )


WIDTH = 128  # rays, so that all rows fit into the first-level cache

(
    OX,
    OY,
    OZ,
    DX,
    DY,
    DZ,
    START,  # input: origin, direction, distance of the start
    BEGIN,
    END,
    MIDDLE,
    HALF,
    MARGIN,
    U0,
    U1,
    U2,
    V0,
    V1,
    V2,
    H0,
    H1,
    H2,
    SINE,
    COSINE,  # the path
) = range(0, 23 * WIDTH, WIDTH)
# These replace the path once a ray has met a cell: the cell and its corners, then the point.
GUESS, LOW, HIGH, ROW, COLUMN, A, B, C, D = range(BEGIN, BEGIN + 9 * WIDTH, WIDTH)
FOUND, U, V, HEIGHT, NX, NY, NZ = range(D + WIDTH, D + 8 * WIDTH, WIDTH)


@kernel
def empty_bundle() -> Floats:
    """A bundle of equal rays that meet nothing; the caller fills in rays."""
    bundle = np.zeros(23 * WIDTH)
    bundle[OX : OX + WIDTH] = 1e8
    bundle[DX : DX + WIDTH] = 1.0
    return bundle


@kernel(borrows=True)
def lay_all(bundle: Floats, lines: Lattice, exact: bool) -> None:
    """The first path of each ray, by `entry_and_exit` and `lay`."""
    for k in range(WIDTH):
        ray, start = ray_of(bundle, k), bundle[START + k]
        begin, end = entry_and_exit(lines, ray, start)
        # The ray of a shadow begins on the surface, where its path must be most accurate.
        ahead = (not exact) & (begin <= start)
        middle, half, margin, path = segment_from(lines, ray, begin, end, ahead)
        bundle[BEGIN + k], bundle[END + k] = begin, end
        bundle[MIDDLE + k], bundle[HALF + k], bundle[MARGIN + k] = middle, half, margin
        bundle[U0 + k], bundle[U1 + k], bundle[U2 + k] = path.u0, path.u1, path.u2
        bundle[V0 + k], bundle[V1 + k], bundle[V2 + k] = path.v0, path.v1, path.v2
        bundle[H0 + k], bundle[H1 + k], bundle[H2 + k] = path.h0, path.h1, path.h2
        bundle[SINE + k], bundle[COSINE + k] = path.sine, path.cosine


@kernel(borrows=True, forceinline=True)
def ray_of(bundle: Floats, k: int) -> Ray:
    """Ray k."""
    return Ray(
        bundle[OX + k],
        bundle[OY + k],
        bundle[OZ + k],
        bundle[DX + k],
        bundle[DY + k],
        bundle[DZ + k],
    )


@kernel(borrows=True, forceinline=True)
def segment_of(bundle: Floats, k: int) -> RaySegment:
    """The first segment of ray k."""
    path = Path(
        bundle[U0 + k],
        bundle[U1 + k],
        bundle[U2 + k],
        bundle[V0 + k],
        bundle[V1 + k],
        bundle[V2 + k],
        bundle[H0 + k],
        bundle[H1 + k],
        bundle[H2 + k],
        bundle[SINE + k],
        bundle[COSINE + k],
    )
    return RaySegment(bundle[MIDDLE + k], bundle[HALF + k], bundle[MARGIN + k], path)


@kernel(borrows=True)
def refine_all(bundle: Floats, lines: Lattice) -> None:
    """The point and the normal in each ray's cell, by `refine` and `normal_at`."""
    for k in range(WIDTH):
        ray = ray_of(bundle, k)
        i, j = bundle[COLUMN + k], bundle[ROW + k]
        b, c, d = bundle[B + k], bundle[C + k], bundle[D + k]
        converged, s, u, v, height, sine, cosine = refine(
            lines, ray, bundle[GUESS + k], j, i, (bundle[A + k], b, c, d)
        )
        nx, ny, nz = normal_at(
            lines,
            ray.x + s * ray.dx,
            ray.y + s * ray.dy,
            height,
            sine,
            cosine,
            b + d * (v - j),
            c + d * (u - i),
        )
        bundle[FOUND + k] = s if converged else np.nan
        bundle[U + k], bundle[V + k], bundle[HEIGHT + k] = u, v, height
        bundle[NX + k], bundle[NY + k], bundle[NZ + k] = nx, ny, nz
