"""A star of a drawn trial -> whether it is found, and where; for compiled code."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.covariance.response import PHASES, RATIOS, REACH, STEP
from startrack.detector.counter import bits, key, uniform
from startrack.detector.normal import inverse_normal
from startrack.detector.poisson import drawn
from startrack.streams import Streams

FALSE = np.uint64(2**63)  # number of the draws of false spots; those of stars are less


# What the detection makes of a star in one trial:
# star        index into the field
# x, y        pixel, true place;  dx, dy  from it to the centroid
# xx, yx, yy  pixel, triangular root of the centroid's covariance
# flux        digital number, that is to be expected;  blur  1, its standard deviation over itself
# surplus     sigma, by which noise makes the star brighter
SIGHT = np.dtype([
    ("star", np.int64),
    *((name, np.float64) for name in ("x", "y", "dx", "dy", "xx", "yx", "yy")),
    *((name, np.float64) for name in ("flux", "blur", "surplus")),
])  # fmt: skip


@njit(cache=True, error_model="numpy")
def sights(a, key, response, pull, field, companions, view):  # type: ignore[no-untyped-def]
    """The stars (k,) that are found in the trial of a key, by a camera whose attitude is `a`."""
    near = in_view(a, field.direction, view)
    found = np.empty(len(near), SIGHT)
    count = 0
    for i in near:
        x, y = _project(a, field.direction[i], view)
        column, row = round(x), round(y)
        if not (
            view.border <= column < view.columns - view.border
            and view.border <= row < view.rows - view.border
        ):
            continue
        start, seen = bits(key, field.number[i]), found[count]
        if not _measure(x, y, column, row, field.flux[i], start, response, seen):
            continue
        for k in range(companions.start[i], companions.start[i + 1]):
            u, v = _project(a, companions.direction[k], view)
            dx, dy = _pulled(u - x, v - y, companions.flux[k] - field.flux[i], pull)
            seen.dx += dx
            seen.dy += dy
        if not np.isnan(seen.dx):
            seen.star, seen.x, seen.y = i, x, y
            count += 1
    return found[:count]


def trial_keys(seed: int, numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The keys of what is drawn in some trials of a seed."""
    return _keys(key(Streams(seed, 0), "covariance"), numbers)


@njit(cache=True, error_model="numpy")
def _keys(start, numbers):  # type: ignore[no-untyped-def]
    keys = np.empty(len(numbers), np.uint64)
    for n in range(len(numbers)):
        keys[n] = bits(start, numbers[n])
    return keys


@njit(cache=True, error_model="numpy")
def false_spots(key, mean):  # type: ignore[no-untyped-def]
    """How many spots are of noise alone in the trial of a key."""
    return int(drawn(mean, uniform(bits(key, FALSE))))


@njit(cache=True, error_model="numpy")
def in_view(a, direction, view):  # type: ignore[no-untyped-def]
    """Which stars (k,) lie in the cone about the frame, of those in order of height (n, 3)."""
    radius, middle = math.acos(view.cosine), math.asin(min(max(a[2, 2], -1.0), 1.0))
    low, high = max(middle - radius, -math.pi / 2), min(middle + radius, math.pi / 2)
    first = np.searchsorted(direction[:, 2], math.sin(low))
    last = np.searchsorted(direction[:, 2], math.sin(high), side="right")
    found = np.empty(last - first, np.int64)
    count = 0
    for i in range(first, last):
        d = direction[i]
        if a[2, 0] * d[0] + a[2, 1] * d[1] + a[2, 2] * d[2] >= view.cosine:
            found[count] = i
            count += 1
    return found[:count]


@njit(cache=True, error_model="numpy", inline="always")
def _project(a, d, view):  # type: ignore[no-untyped-def]
    """`Camera.project` of one direction in front of the camera."""
    z = a[2, 0] * d[0] + a[2, 1] * d[1] + a[2, 2] * d[2]
    u = (a[0, 0] * d[0] + a[0, 1] * d[1] + a[0, 2] * d[2]) / z
    v = (a[1, 0] * d[0] + a[1, 1] * d[1] + a[1, 2] * d[2]) / z
    r = u * u + v * v
    radial = 1 + r * (view.k1 + r * (view.k2 + r * view.k3))
    x = u * radial + 2 * view.p1 * u * v + view.p2 * (r + 2 * u * u)
    y = v * radial + view.p1 * (r + 2 * v * v) + 2 * view.p2 * u * v
    return view.centre_x + view.focal * x, view.centre_y + view.focal * y


@njit(cache=True, error_model="numpy")
def _measure(x, y, column, row, flux, start, response, seen):  # type: ignore[no-untyped-def]
    """Whether a star alone, at a place in a pixel, is found; writes how it is measured."""
    i = min(int((x - column + 0.5) * PHASES), PHASES - 1)
    j = min(int((y - row + 0.5) * PHASES), PHASES - 1)
    at = (flux - response.first) / STEP
    k = min(max(int(at), 0), len(response.above) - 2)
    t = min(max(at - k, 0.0), 1.0)
    above = (1 - t) * response.above[k, j, i] + t * response.above[k + 1, j, i]
    seen.surplus = inverse_normal(uniform(bits(start, np.uint64(0))))
    kept = (1 - t) * response.kept[k, j, i] + t * response.kept[k + 1, j, i]
    if not above + seen.surplus > 0 or uniform(bits(start, np.uint64(3))) > kept:
        return False
    normal_x = inverse_normal(uniform(bits(start, np.uint64(1))))
    normal_y = inverse_normal(uniform(bits(start, np.uint64(2))))
    electrons = math.exp(flux)
    seen.xx = _between(response.root, k, t, j, i, 0) / electrons
    seen.yx = _between(response.root, k, t, j, i, 1) / electrons
    seen.yy = _between(response.root, k, t, j, i, 2) / electrons
    seen.dx = _between(response.bias, k, t, j, i, 0) + seen.xx * normal_x
    seen.dy = _between(response.bias, k, t, j, i, 1) + seen.yx * normal_x + seen.yy * normal_y
    seen.flux = _between(response.light, k, t, j, i, 0) * electrons
    seen.blur = _between(response.light, k, t, j, i, 1)
    return True


@njit(cache=True, error_model="numpy", inline="always")
def _between(table, k, t, j, i, c):  # type: ignore[no-untyped-def]
    return (1 - t) * table[k, j, i, c] + t * table[k + 1, j, i, c]


@njit(cache=True, error_model="numpy")
def _pulled(dx, dy, ratio, pull):  # type: ignore[no-untyped-def]
    """How far a companion pulls a centroid; NaN where it swallows the star."""
    r, q = (ratio - RATIOS[0]) / (RATIOS[1] - RATIOS[0]), len(RATIOS) - 1
    if not (abs(dx) < REACH and abs(dy) < REACH) or r < 0:
        return 0.0, 0.0
    if np.isnan(pull[min(int(r + 0.5), q), round(dy) + REACH, round(dx) + REACH, 0]):
        return np.nan, np.nan
    k, i, j = min(int(r), q - 1), int(dx + REACH), int(dy + REACH)
    t, u, v = min(r - k, 1.0), dx + REACH - i, dy + REACH - j
    x = y = total = 0.0
    for n in range(8):
        c, b, a = n // 4, (n // 2) % 2, n % 2
        weight = (t if c else 1 - t) * (v if b else 1 - v) * (u if a else 1 - u)
        one = pull[k + c, j + b, i + a]
        if not np.isnan(one[0]):
            x, y, total = x + weight * one[0], y + weight * one[1], total + weight
    return x / total, y / total
