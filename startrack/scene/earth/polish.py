"""A ray and the cell where it meets a surface -> the exact point and the surface's normal there."""

from __future__ import annotations

import math

from numba import njit

from startrack.scene.earth.ellipsoid import ECCENTRICITY_2, EQUATORIAL
from startrack.scene.earth.march import above
from startrack.scene.earth.path import path_at

POLISHED = 1e-9  # metre, what Newton's next step would still change
NEAR = 1.0  # metre, over which a path is its ray to 1e-12 m, and the vertical to 2e-7 radian
STEPS = 60  # of bisection at worst, which take a path of 100 km to 1e-13 m


@njit(cache=True, error_model="numpy", forceinline=True)
def refine(lines, ox, oy, oz, dx, dy, dz, guess, i, j, a, b, c, d):  # type: ignore[no-untyped-def]
    """Three steps of Newton's method in one cell, from a guess that is nearly right.

    i, j     column and row of the cell
    a, b, c, d  as of `corners`
    Returns  whether they found the point; its distance; columns, rows and height there, sine and
             cosine of the latitude
    """
    path = path_at(lines, ox + guess * dx, oy + guess * dy, oz + guess * dz, dx, dy, dz)
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
    found = (abs(step) < POLISHED) & (abs(t) < NEAR) & (change < 0)
    found = found & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    return found, guess + t, u + i, v + j, height, path.sine, path.cosine


@njit(cache=True, error_model="numpy")
def settle(lines, heights, slot, j, i, ox, oy, oz, dx, dy, dz, low, high, s):  # type: ignore[no-untyped-def]
    """The root between two distances, where the ray goes from above the surface to below.

    Newton's method, kept between its bounds, on paths that are laid anew where it strays.
    """
    base = s
    path = path_at(lines, ox + s * dx, oy + s * dy, oz + s * dz, dx, dy, dz)
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
            path = path_at(lines, ox + s * dx, oy + s * dy, oz + s * dz, dx, dy, dz)
    t = s - base
    u, v = path.u0 + t * (path.u1 + t * path.u2), path.v0 + t * (path.v1 + t * path.v2)
    return s, u, v, path.h0 + t * (path.h1 + t * path.h2), path.sine, path.cosine


@njit(cache=True, error_model="numpy", forceinline=True)
def normal_at(lines, x, y, height, sine, cosine, to_column, to_row):  # type: ignore[no-untyped-def]
    """The normal of the surface at a point of it, from its change with columns and rows.

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
