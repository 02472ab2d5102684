"""A ray and a surface -> the nearest point where they meet: max-mip marching on curved paths.

Blocks of cells are skipped where the path stays above their maximum by more than it may be wrong;
what remains within a cell is decided on the exact geodetic height of the ray.
"""

from __future__ import annotations

import math

from numba import njit

from startrack.scene.earth.ellipsoid import shell
from startrack.scene.earth.path import crossing, path_at, reach
from startrack.scene.earth.surface import FULL_TURN, corners
from startrack.scene.earth.tile import CELLS, SIZE, block

MISS, HIT, ABSENT = 0, 1, 2  # absent: the ray has come to a tile that is not in memory
SHELL_MARGIN = 2.0  # metre, more than `shell` differs from a surface of constant height
POLISHED = 1e-9  # metre, what Newton's next step would still change
NEAR = 1.0  # metre, over which a path is its ray to 1e-12 m, and the vertical to 2e-7 radian
NOWHERE = (0.0, 0.0, 0.0, 0.0, 0.0)
STEPS = 60  # of bisection at worst, which take a path of 100 km to 1e-13 m


@njit(cache=True, error_model="numpy")
def march(surface, ox, oy, oz, dx, dy, dz, start, exact):  # type: ignore[no-untyped-def]
    """Follow one ray, a unit direction from a point, from the distance `start` on.

    exact    whether to find the point; a shadow only asks if there is one
    Returns  MISS, HIT or ABSENT; its distance, or the one from which to go on; row and column of
             the tile that was hit or is absent; of a hit columns, rows, height, and sine and
             cosine of the latitude
    """
    enter, end = shell(ox, oy, oz, dx, dy, dz, surface.highest + SHELL_MARGIN)
    begin = max(start, enter)
    below, _ = shell(ox, oy, oz, dx, dy, dz, surface.lowest - SHELL_MARGIN)
    if below > begin:
        end = min(end, below)
    while begin < end:
        x, y, z = ox + begin * dx, oy + begin * dy, oz + begin * dz
        half, margin = reach(surface, x, y, z, dx, dy, dz, 0.5 * (end - begin))
        # A shadow begins on the surface, where the path must be best.
        back = half if exact or begin > start else 0.0
        middle = begin + back
        x, y, z = ox + middle * dx, oy + middle * dy, oz + middle * dz
        path = path_at(surface, x, y, z, dx, dy, dz, margin)
        status, distance, j, i, where = _along(
            surface, path, -back, half, x, y, z, dx, dy, dz, exact
        )
        if status != MISS:
            return status, middle + distance, j, i, where
        if middle + half <= begin:
            break
        begin = middle + half
    return MISS, math.inf, 0, 0, NOWHERE


@njit(cache=True, error_model="numpy")
def _along(surface, path, begin, half, x, y, z, dx, dy, dz, exact):  # type: ignore[no-untyped-def]
    """Follow a path from `begin` to half, in pieces on which columns and rows are monotonic."""
    first = _turning(path.u1, path.u2, half)
    second = _turning(path.v1, path.v2, half)
    for end in (min(first, second), max(first, second), half):
        if end <= begin:
            continue
        middle = 0.5 * (begin + end)
        east = 1 if path.u1 + 2 * path.u2 * middle >= 0 else -1
        south = 1 if path.v1 + 2 * path.v2 * middle >= 0 else -1
        # A path that leaves a closed grid on one side comes back on the other.
        for side in (-east, 0, east):
            u0 = path.u0 - side * FULL_TURN / surface.step_x
            from_, to = _within(u0, path.u1, path.u2, east, surface.columns, begin, end)
            if from_ < to:
                from_, to = _within(path.v0, path.v1, path.v2, south, surface.rows, from_, to)
            if from_ < to:
                status, distance, j, i, where = _through(
                    surface, path, u0, half, from_, to, east, south, x, y, z, dx, dy, dz, exact
                )
                if status != MISS:
                    return status, distance, j, i, where
        begin = end
    return MISS, math.inf, 0, 0, NOWHERE


@njit(cache=True, error_model="numpy")
def _turning(q1, q2, half):  # type: ignore[no-untyped-def]
    """Where a quadratic turns around, if it does between -half and half; else half."""
    if abs(q1) >= 2 * abs(q2) * half:
        return half
    return -q1 / (2 * q2)


@njit(cache=True, error_model="numpy")
def _within(q0, q1, q2, sign, cells, begin, end):  # type: ignore[no-untyped-def]
    """The part of a monotonic piece on which a coordinate lies between 0 and `cells`."""
    at_begin, at_end = q0 + begin * (q1 + begin * q2), q0 + end * (q1 + end * q2)
    early, late = (0.0, float(cells)) if sign > 0 else (float(cells), 0.0)
    if sign * (at_end - early) < 0 or sign * (at_begin - late) > 0:
        return end, begin
    if sign * (at_begin - early) < 0:
        begin = max(begin, crossing(q0, q1, q2, sign, early))
    if sign * (at_end - late) > 0:
        end = min(end, crossing(q0, q1, q2, sign, late))
    return begin, end


@njit(cache=True, error_model="numpy")
def _cell(position, low, high):  # type: ignore[no-untyped-def]
    return min(max(math.floor(position), low), high)


# Long, because each step needs nearly all of the state: place, block, tile.
@njit(cache=True, error_model="numpy")
def _through(  # type: ignore[no-untyped-def]
    surface, path, u0, half, s, end, east, south, x, y, z, dx, dy, dz, exact
):
    """Follow a monotonic piece through the blocks of the grid."""
    u1, u2 = path.u1, path.u2
    v0, v1, v2 = path.v0, path.v1, path.v2
    h0, h1, h2 = path.h0, path.h1, path.h2
    # Taken out of the tuple once: numba counts references each time.
    heights, maxima, top, used = surface.heights, surface.maxima, surface.top, surface.used
    last_i, last_j = surface.columns - 1, surface.rows - 1
    i, j = _cell(u0 + s * (u1 + s * u2), 0, last_i), _cell(v0 + s * (v1 + s * v2), 0, last_j)
    slot = surface.slot[j >> SIZE, i >> SIZE]
    level = SIZE
    if slot >= 0:  # in memory: begin with blocks about as large as the piece is long
        extent = max(abs(u0 + end * (u1 + end * u2) - i), abs(v0 + end * (v1 + end * v2) - j))
        level = 0
        while level < SIZE and extent > (1 << level):
            level += 1
    while True:
        west, north = (i >> level) << level, (j >> level) << level
        past_i, past_j = west + (1 << level), north + (1 << level)
        exit_u = crossing(u0, u1, u2, east, float(past_i if east > 0 else west))
        exit_v = crossing(v0, v1, v2, south, float(past_j if south > 0 else north))
        leave = max(s, min(min(exit_u, exit_v), end))
        slope = h1 + 2 * s * h2
        lowest = h0 + s * (h1 + s * h2) if slope >= 0 else h0 + leave * (h1 + leave * h2)
        if slope < 0 < h1 + 2 * leave * h2:
            lowest = h0 - 0.25 * h1 * h1 / h2
        bound = math.inf
        if level == SIZE:
            bound = top[j >> SIZE, i >> SIZE]
        elif level > 0:
            bound = maxima[
                slot, block(level, (j & (CELLS - 1)) >> level, (i & (CELLS - 1)) >> level)
            ]
        if lowest <= bound + path.margin:
            if level > 0:
                if level == SIZE:
                    slot = surface.slot[j >> SIZE, i >> SIZE]
                    if slot < 0:
                        return ABSENT, s, j >> SIZE, i >> SIZE, NOWHERE
                # The height is convex, so its tangent reaches the bound before the path does.
                spare = h0 + s * (h1 + s * h2) - bound - path.margin
                if spare > 0 and slope < 0:
                    s = min(s - spare / slope, leave)
                    i = _cell(u0 + s * (u1 + s * u2), west, min(past_i - 1, last_i))
                    j = _cell(v0 + s * (v1 + s * v2), north, min(past_j - 1, last_j))
                level -= 1
                continue
            used[slot] = 1
            found = _leaf(
                surface, heights, path, u0, half, s, leave, slot, j, i, x, y, z, dx, dy, dz, exact
            )
            if found[0] == HIT:
                return HIT, found[1], j >> SIZE, i >> SIZE, found[2]
        if leave >= end:
            return MISS, math.inf, 0, 0, NOWHERE
        s = leave
        old_j, old_i = j, i
        if exit_u <= exit_v:
            i = past_i if east > 0 else west - 1
            j = _cell(v0 + s * (v1 + s * v2), north, min(past_j - 1, last_j))
            outer = (old_i ^ i) >> (level + 1)
        else:
            j = past_j if south > 0 else north - 1
            i = _cell(u0 + s * (u1 + s * u2), west, min(past_i - 1, last_i))
            outer = (old_j ^ j) >> (level + 1)
        if i < 0 or j < 0 or i > last_i or j > last_j:
            return MISS, math.inf, 0, 0, NOWHERE
        if outer and level < SIZE:  # out of the block around this one too
            level += 1
            if (old_i ^ i) >> SIZE or (old_j ^ j) >> SIZE:
                slot = surface.slot[j >> SIZE, i >> SIZE]
                level = SIZE


@njit(cache=True, error_model="numpy")
def _leaf(  # type: ignore[no-untyped-def]
    surface, heights, path, u0, reached, s, leave, slot, j, i, x, y, z, dx, dy, dz, exact
):
    """Whether and where the ray meets the surface of one cell, between two distances.

    A parabola through three heights above the surface tells: clear of it, clearly through it, or
    to be decided on exact heights.
    """
    a, b, c, d = corners(heights, slot, j & (CELLS - 1), i & (CELLS - 1))
    half = 0.5 * (leave - s)
    first = second = third = 0.0
    for turn in range(3):
        first, second = second, third
        here = s + turn * half
        u = u0 + here * (path.u1 + here * path.u2) - i
        v = path.v0 + here * (path.v1 + here * path.v2) - j
        third = path.h0 + here * (path.h1 + here * path.h2) - (a + b * u + c * v + d * u * v)
    # What the path may be wrong by grows with the cube of the distance from its middle.
    share = max(abs(s), abs(leave)) / reached
    margin = path.margin * share * share * share
    if not _dip(first, second, third)[0] <= margin:  # true of a hole too
        return MISS, math.inf, NOWHERE
    if first > margin and third < -margin:
        if not exact:
            return HIT, s, NOWHERE
        bend, slope = 0.5 * (first + third) - second, 0.5 * (third - first)
        place = 2 * second / (math.sqrt(max(0.0, slope * slope - 4 * bend * second)) - slope)
        guess = s + half * (1 + min(max(place, -1.0), 1.0))
        return _settle(surface, heights, slot, j, i, x, y, z, dx, dy, dz, s, leave, guess)
    low, high, guess = s, leave, s + half
    for turn in range(4):
        here = guess if turn == 3 else s + turn * half
        exact_path = path_at(surface, x + here * dx, y + here * dy, z + here * dz, dx, dy, dz, 0.0)
        value = _above(surface, heights, slot, j, i, exact_path, 0.0)[0]
        if turn == 0 and value <= 0:
            # From the side: out of a hole, over an edge, from below.
            return HIT, s, _where(exact_path, 0.0)
        if value <= 0:
            high = here
            break
        first, second, third = second, third, value
        if turn == 2:
            place = _dip(first, second, third)[1]
            if not -1 < place < 1:
                return MISS, math.inf, NOWHERE
            guess = s + half * (1 + place)
    if not value <= 0:
        return MISS, math.inf, NOWHERE
    if not exact:
        return HIT, low, NOWHERE
    return _settle(surface, heights, slot, j, i, x, y, z, dx, dy, dz, low, high, 0.5 * (low + high))


@njit(cache=True, error_model="numpy")
def _dip(first, second, third):  # type: ignore[no-untyped-def]
    """Least value of the parabola through values at -1, 0 and 1 within [-1, 1], and its place."""
    slope, bend = 0.5 * (third - first), 0.5 * (first + third) - second
    if bend > 0 and abs(slope) < 2 * bend:
        return second - 0.25 * slope * slope / bend, -0.5 * slope / bend
    if first < third:
        return first, -1.0
    return third, 1.0  # of NaN, NaN


@njit(cache=True, error_model="numpy")
def _above(surface, heights, slot, j, i, path, s):  # type: ignore[no-untyped-def]
    """Height of an exact path above the surface, its change with the distance, and its twist.

    The cell is the one near [j, i] that the place falls into: the value is continuous.
    """
    turn = FULL_TURN / surface.step_x
    u0 = path.u0 - turn * math.floor((path.u0 - i) / turn + 0.5)
    u = u0 + s * (path.u1 + s * path.u2) - ((i >> SIZE) << SIZE)
    v = path.v0 + s * (path.v1 + s * path.v2) - ((j >> SIZE) << SIZE)
    i = _cell(u, 0, min(CELLS, surface.columns - ((i >> SIZE) << SIZE)) - 1)
    j = _cell(v, 0, min(CELLS, surface.rows - ((j >> SIZE) << SIZE)) - 1)
    a, b, c, d = corners(heights, slot, j, i)
    u, v = u - i, v - j
    to_column, to_row = path.u1 + 2 * s * path.u2, path.v1 + 2 * s * path.v2
    height = path.h0 + s * (path.h1 + s * path.h2)
    change = path.h1 + 2 * s * path.h2 - (b + d * v) * to_column - (c + d * u) * to_row
    return height - (a + b * u + c * v + d * u * v), change, abs(2 * d * to_column * to_row)


@njit(cache=True, error_model="numpy")
def _settle(surface, heights, slot, j, i, x, y, z, dx, dy, dz, low, high, s):  # type: ignore[no-untyped-def]
    """The root between two distances, where the ray goes from above the surface to below.

    Newton's method, kept between its bounds, on paths that are laid anew where it strays.
    """
    base = s
    path = path_at(surface, x + s * dx, y + s * dy, z + s * dz, dx, dy, dz, 0.0)
    for _ in range(STEPS):
        value, change, twist = _above(surface, heights, slot, j, i, path, s - base)
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
            path = path_at(surface, x + s * dx, y + s * dy, z + s * dz, dx, dy, dz, 0.0)
    return HIT, s, _where(path, s - base)


@njit(cache=True, error_model="numpy")
def _where(path, s):  # type: ignore[no-untyped-def]
    """Columns, rows, height, sine and cosine of the latitude at a distance of metres at most."""
    return (
        path.u0 + s * (path.u1 + s * path.u2), path.v0 + s * (path.v1 + s * path.v2),
        path.h0 + s * (path.h1 + s * path.h2), path.sine, path.cosine,
    )  # fmt: skip
