"""The cell in which a ray first meets a surface: max-mip marching on curved paths.

Blocks of cells are skipped where the path stays above their maximum by more than its error. Within
a cell, the exact geodetic height of the ray decides where the path cannot.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Singles, kernel
from startrack.earth.terrain.ellipsoid import shell
from startrack.earth.terrain.path import Path, Ray, crossing, path_at, reach
from startrack.earth.terrain.surface import Horizon, Lattice, Surface, corners
from startrack.earth.terrain.tile import CELLS, PATCH, SIZE, block, patch

MISS, HIT, ABSENT = 0, 1, 2  # ABSENT: the ray needs a tile that is not in memory
CLEAR = 3  # above all terrain ahead, on this path and on later paths
# metre, above the deviation of `shell` from a surface of constant height up to 9 km
SHELL_MARGIN = 2.0
DIVE = 4  # levels per descent of a ray that falls more steeply than 8 to 1
CLOSED = 1e-6  # metre, above the rounding of the height above a surface at cell borders
JUST = 0.1  # metre, above the error of a path along its ray
STRAIGHT = 5e-4  # 1, largest curvature of a path for which `crossing` is a series
# fraction of a turn; a path cannot leave a narrower grid and return on the other side
SEAMLESS = 0.9


class RaySegment(NamedTuple):
    """A part of a ray, and the path that approximates it.

    middle  metre along the ray, zero of the path's distances
    half    metre, half the length
    margin  metre, bound of the error of the path's height at the ends
    """

    middle: float
    half: float
    margin: float
    path: Path


class Piece(NamedTuple):
    """A part of a path on which columns and rows are monotonic.

    u0           column of the path at its middle, less whole turns around the Earth
    begin, end   metre from the middle of the path; `begin` may lie outside the grid
    east, south  1 where columns or rows grow, else -1
    """

    u0: float
    begin: float
    end: float
    east: int
    south: int


@kernel(forceinline=True)
def entry_and_exit(lines: Lattice, ray: Ray, start: float) -> tuple[float, float]:
    """Distances between which a ray can meet a surface; the second is the smaller if it cannot."""
    enter, end = shell(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, lines.highest + SHELL_MARGIN)
    below, _ = shell(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, lines.lowest - SHELL_MARGIN)
    begin = start if start > enter else enter
    return begin, below if begin < below < end else end


@kernel(forceinline=True)
def segment_from(lines: Lattice, ray: Ray, begin: float, end: float, ahead: bool) -> RaySegment:
    """The segment of a ray that begins at `begin`.

    ahead  whether the middle, where the path is exact, lies at `begin`; else half a length farther
    """
    wish = end - begin if ahead else 0.5 * (end - begin)
    half, margin = reach(lines, ray, begin, wish)
    middle = begin if ahead else begin + half
    return RaySegment(middle, half, margin, path_at(lines, ray, middle))


@kernel(borrows=True, forceinline=True)
def march(
    lines: Lattice, surface: Surface, ray: Ray, segment: RaySegment, begin: float, end: float
) -> tuple[int, float, float, float, int, int]:
    """Follow one ray, a unit direction from a point, on its first path and on later paths.

    Returns  MISS, HIT or ABSENT; three distances: two that enclose the intersection, and an
             estimate of it (all three are the distance to continue from, if ABSENT); row and column
             of the hit cell or of the absent tile
    """
    while True:
        middle, half = segment.middle, segment.half
        status, low, high, guess, j, i = _along(lines, surface, ray, segment, begin - middle)
        if status == CLEAR:
            return MISS, math.inf, math.inf, math.inf, 0, 0
        if status != MISS:
            return status, middle + low, middle + high, middle + guess, j, i
        if not begin < middle + half < end:
            return MISS, math.inf, math.inf, math.inf, 0, 0
        begin = middle + half
        segment = segment_from(lines, ray, begin, end, False)


@kernel(borrows=True, forceinline=True)
def _along(
    lines: Lattice, surface: Surface, ray: Ray, segment: RaySegment, begin: float
) -> tuple[int, float, float, float, int, int]:
    """Follow a path from `begin` to half, in pieces on which columns and rows are monotonic."""
    path, half = segment.path, segment.half
    first = _turning(path.u1, path.u2, half)
    second = _turning(path.v1, path.v2, half)
    # A path that leaves a closed grid on one side enters it on the other.
    around = 1 if lines.columns > SEAMLESS * lines.turn else 0
    for end in (min(first, second), max(first, second), half):
        if end <= begin:
            continue
        centre = 0.5 * (begin + end)
        east = 1 if path.u1 + 2 * path.u2 * centre >= 0 else -1
        south = 1 if path.v1 + 2 * path.v2 * centre >= 0 else -1
        for side in range(-around, around + 1):
            u0 = path.u0 - east * side * lines.turn
            from_, to = _within(u0, path.u1, path.u2, east, lines.columns, begin, end)
            if from_ < to:
                from_, to = _within(path.v0, path.v1, path.v2, south, lines.rows, from_, to)
            if from_ < to:
                piece = Piece(u0, begin, to, east, south)
                status = _through(lines, surface, ray, segment, piece, from_)
                if status[0] != MISS:
                    return status
        begin = end
    return MISS, math.inf, math.inf, math.inf, 0, 0


@kernel
def _turning(q1: float, q2: float, half: float) -> float:
    """Extremum of a quadratic between -half and half; half if there is none."""
    if abs(q1) >= 2 * abs(q2) * half:
        return half
    return -q1 / (2 * q2)


@kernel
def _within(
    q0: float, q1: float, q2: float, sign: int, cells: int, begin: float, end: float
) -> tuple[float, float]:
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


@kernel(forceinline=True)
def _border(
    q0: float, q1: float, q2: float, inverse: float, curl: float, sign: int, target: float
) -> float:
    """As `crossing`, from 1 / q1 and q2 / q1, which are NaN for the other branch."""
    straight = (target - q0) * inverse
    bend = straight * curl
    if abs(bend) < STRAIGHT:
        return straight * (1 - bend * (1 - bend * (2 - bend * (5 - bend * 14))))
    return crossing(q0, q1, q2, sign, target)


@kernel(forceinline=True)
def _cell(position: float, low: int, high: int) -> int:
    return min(max(math.floor(position), low), high)


class Rates(NamedTuple):
    """Bounds of the rest of a monotonic piece.

    u, v   largest columns and rows per metre
    slack  1, largest growth of the error of the path's slope
    """

    u: float
    v: float
    slack: float


@kernel(forceinline=True)
def _rates_of(segment: RaySegment, s: float, end: float) -> Rates:
    path = segment.path
    return Rates(
        max(abs(path.u1 + 2 * s * path.u2), abs(path.u1 + 2 * end * path.u2)),
        max(abs(path.v1 + 2 * s * path.v2), abs(path.v1 + 2 * end * path.v2)),
        3 * segment.margin / segment.half,
    )


class Borders(NamedTuple):
    """Borders of the blocks that a monotonic piece of a ray crosses.

    last_u, last_v   column and row at the end of the piece
    end_i, end_j     cell at the end of the piece
    per_u, per_v     metre per column and row; NaN where the piece is on the other branch
    curl_u, curl_v   1 / metre, curvature of columns and rows over their slope
    past_u, past_v   blocks between the near border of a block and the border where the piece leaves
    """

    last_u: float
    last_v: float
    end_i: int
    end_j: int
    per_u: float
    per_v: float
    curl_u: float
    curl_v: float
    past_u: int
    past_v: int


@kernel(forceinline=True)
def _borders_of(path: Path, piece: Piece) -> Borders:
    last_u = _at(piece.u0, path.u1, path.u2, piece.end)
    last_v = _at(path.v0, path.v1, path.v2, piece.end)
    per_u = 1 / path.u1 if piece.east * path.u1 > 0 else math.nan
    per_v = 1 / path.v1 if piece.south * path.v1 > 0 else math.nan
    return Borders(
        last_u,
        last_v,
        math.floor(last_u),
        math.floor(last_v),
        per_u,
        per_v,
        path.u2 * per_u,
        path.v2 * per_v,
        1 if piece.east > 0 else 0,
        1 if piece.south > 0 else 0,
    )


@kernel(forceinline=True)
def _exits(
    borders: Borders, path: Path, piece: Piece, level: int, j: int, i: int
) -> tuple[float, float]:
    """Distances at which a piece leaves its block through a column and through a row.

    Infinity where the piece ends inside the block.
    """
    exit_u = exit_v = math.inf
    if (i ^ borders.end_i) >> level:
        column = float(((i >> level) + borders.past_u) << level)
        exit_u = _border(
            piece.u0, path.u1, path.u2, borders.per_u, borders.curl_u, piece.east, column
        )
    if (j ^ borders.end_j) >> level:
        row = float(((j >> level) + borders.past_v) << level)
        exit_v = _border(path.v0, path.v1, path.v2, borders.per_v, borders.curl_v, piece.south, row)
    return exit_u, exit_v


@kernel(borrows=True, forceinline=True)
def _through(
    lines: Lattice, surface: Surface, ray: Ray, segment: RaySegment, piece: Piece, s: float
) -> tuple[int, float, float, float, int, int]:
    """Follow a monotonic piece from `s` on through the blocks of the grid.

    A block is split where the path falls below its maximum. In a single cell `_cell_by_parabola` or
    `_cell_exact` decides. Then the path goes on to the next block.

    Returns  as `march`, with distances from the middle of the path; CLEAR where nothing lies ahead
    """
    # Read once: numba counts each use of a tuple's array.
    heights, maxima, steepness = surface.heights, surface.maxima, surface.steepness
    top, slots, used, horizon = surface.top, surface.slot, surface.used, surface.horizon
    path, margin, u0, end = segment.path, segment.margin, piece.u0, piece.end
    last_i, last_j = lines.columns - 1, lines.rows - 1
    i = _cell(_at(u0, path.u1, path.u2, s), 0, last_i)
    j = _cell(_at(path.v0, path.v1, path.v2, s), 0, last_j)
    borders, rates = _borders_of(path, piece), _rates_of(segment, s, end)
    slot = slots[j >> SIZE, i >> SIZE]
    extent = max(abs(borders.last_u - i), abs(borders.last_v - j))
    level, sure, drop = _first_block(
        heights, maxima, steepness, used, segment, u0, rates, slot, j, i, s, extent
    )
    while True:
        exit_u, exit_v = _exits(borders, path, piece, level, j, i)
        leave = max(s, min(min(exit_u, exit_v), end))
        slope = path.h1 + 2 * s * path.h2
        if sure and slope > 0 and len(horizon.bound) > 0:
            u, v = _at(u0, path.u1, path.u2, s), _at(path.v0, path.v1, path.v2, s)
            if _at(path.h0, path.h1, path.h2, s) - margin > _horizon_at(horizon, u, v):
                return CLEAR, math.inf, math.inf, math.inf, 0, 0
        bound = _highest(top, maxima, slot, level, j, i)
        if _lowest(path, slope, s, leave) <= bound + margin and not (
            slope > 0
            and sure
            and level >= PATCH
            and slot >= 0
            and _too_steep(steepness, slot, level, j, i, slope, rates)
        ):
            if level > 0:
                if level == SIZE:
                    slot = slots[j >> SIZE, i >> SIZE]
                    if slot < 0:
                        return ABSENT, s, s, s, j >> SIZE, i >> SIZE
                # The height is convex, so its tangent reaches the bound before the path does.
                spare = _at(path.h0, path.h1, path.h2, s) - bound - margin
                if spare > 0 and slope < 0:
                    s = min(s - spare / slope, leave)
                    i = _cell_in_block(_at(u0, path.u1, path.u2, s), i, level, last_i)
                    j = _cell_in_block(_at(path.v0, path.v1, path.v2, s), j, level, last_j)
                level = max(0, level - drop)
                continue
            used[slot] = 1
            status, low, high, guess = _cell_by_parabola(heights, segment, u0, s, leave, slot, j, i)
            if status == ABSENT:
                status, low, high, guess = _cell_exact(
                    lines, heights, ray, segment.middle, piece, s, leave, slot, j, i
                )
            if status == HIT:
                return HIT, low, high, guess, j, i
            sure = not math.isnan(low)
        else:
            sure = bound > -math.inf  # no hole: in a hole a ray could continue below the surface
        if leave >= end:
            return MISS, math.inf, math.inf, math.inf, 0, 0
        s, old_j, old_i, by_column = leave, j, i, exit_u <= exit_v
        if by_column:
            i = _next_block(i, level, piece.east)
            j = _cell_in_block(_at(path.v0, path.v1, path.v2, s), j, level, last_j)
        else:
            j = _next_block(j, level, piece.south)
            i = _cell_in_block(_at(u0, path.u1, path.u2, s), i, level, last_i)
        outer = ((old_i ^ i) if by_column else (old_j ^ j)) >> (level + 1)
        if i < 0 or j < 0 or i > last_i or j > last_j:
            return MISS, math.inf, math.inf, math.inf, 0, 0
        if outer and level < SIZE:  # the piece leaves the next larger block, too
            level += 1
            if (old_i ^ i) >> SIZE or (old_j ^ j) >> SIZE:
                slot = slots[j >> SIZE, i >> SIZE]
                level = SIZE


@kernel(forceinline=True)
def _at(q0: float, q1: float, q2: float, s: float) -> float:
    """A coordinate of a path at the distance `s`."""
    return q0 + s * (q1 + s * q2)


@kernel(borrows=True)
def _first_block(
    heights: Singles,
    maxima: Singles,
    steepness: Singles,
    used: NDArray[np.uint8],
    segment: RaySegment,
    u0: float,
    rates: Rates,
    slot: int,
    j: int,
    i: int,
    s: float,
    extent: float,
) -> tuple[int, bool, int]:
    """Level of the first block of a piece in the cell [j, i].

    extent   cells, length of the piece along columns or rows
    Returns  level; whether the path is surely above the surface there; levels of one descent
    """
    path, level, sure, drop = segment.path, SIZE, False, 1
    slope = path.h1 + 2 * s * path.h2
    if slot >= 0 and slope > 0:
        used[slot] = 1
        sure = _over(heights, path, u0, slot, j, i, s)
        level = 0
        if sure:
            height = _at(path.h0, path.h1, path.h2, s) - segment.margin
            level = _start(maxima, steepness, slot, j, i, height, slope, rates)
    elif slot >= 0:  # begin with blocks about as large as the piece
        level = 0
        while level < SIZE and extent > (1 << level):
            level += 1
        # A steeply falling ray meets the surface of a block soon after it falls below its maximum.
        steep = slope * slope / (1 - slope * slope)
        while steep > 4 and drop < DIVE:
            steep *= 0.25
            drop += 1
    return level, sure, drop


@kernel(forceinline=True)
def _lowest(path: Path, slope: float, s: float, leave: float) -> float:
    """Least height of a path between two distances; `slope` is its slope at the first."""
    if slope < 0 < path.h1 + 2 * leave * path.h2:
        return path.h0 - 0.25 * path.h1 * path.h1 / path.h2
    return _at(path.h0, path.h1, path.h2, s if slope >= 0 else leave)


@kernel(borrows=True, forceinline=True)
def _highest(top: Floats, maxima: Singles, slot: int, level: int, j: int, i: int) -> float:
    """Largest height of the block around the cell [j, i]; infinity for a single cell."""
    if level == SIZE:
        return top[j >> SIZE, i >> SIZE]
    if level == 0:
        return math.inf
    n = block(level, (j & (CELLS - 1)) >> level, (i & (CELLS - 1)) >> level)
    return maxima[slot, n]


@kernel(forceinline=True)
def _cell_in_block(position: float, cell: int, level: int, last: int) -> int:
    """Index of the cell at a position, clipped to the block of another cell and to the grid."""
    first = (cell >> level) << level
    return _cell(position, first, min(first + (1 << level) - 1, last))


@kernel(forceinline=True)
def _next_block(cell: int, level: int, sign: int) -> int:
    """Index of the first cell beyond the block of a cell."""
    first = (cell >> level) << level
    return first + (1 << level) if sign > 0 else first - 1


@kernel(borrows=True, forceinline=True)
def _horizon_at(horizon: Horizon, u: float, v: float) -> float:
    """Height above which rays at a point meet nothing any more."""
    ahead, across = (v, u) if horizon.by_rows else (u, v)
    along = horizon.offset + horizon.sign * ahead
    column = math.floor(along * horizon.per_side)
    strip = math.floor((across - horizon.shear * along - horizon.begin) * horizon.per_side)
    many, strips = horizon.bound.shape
    if column < 0 or strip < 0 or column >= many or strip >= strips:
        return math.inf
    return float(horizon.bound[column, strip])


@kernel(borrows=True, forceinline=True)
def _cell_by_parabola(
    heights: Singles,
    segment: RaySegment,
    u0: float,
    s: float,
    leave: float,
    slot: int,
    j: int,
    i: int,
) -> tuple[int, float, float, float]:
    """Whether the path meets the surface of one cell between two distances, and an estimated
    distance.

    A parabola through three heights above the surface decides: MISS, HIT, or ABSENT where exact
    heights must decide. In a hole the first returned distance is NaN.
    """
    a, b, c, d = corners(heights, slot, j & (CELLS - 1), i & (CELLS - 1))
    path, half = segment.path, 0.5 * (leave - s)
    first = _clear(path, u0 - i, path.v0 - j, a, b, c, d, s)
    second = _clear(path, u0 - i, path.v0 - j, a, b, c, d, s + half)
    third = _clear(path, u0 - i, path.v0 - j, a, b, c, d, leave)
    # The error of the path grows with the cube of the distance from its middle.
    fraction = max(abs(s), abs(leave)) / segment.half
    margin = segment.margin * (fraction * fraction * fraction)
    if not _parabola_minimum(first, second, third)[0] <= margin:  # also true for a hole
        return MISS, first, math.inf, math.inf
    if first > margin and third < -margin:
        bend, slope = 0.5 * (first + third) - second, 0.5 * (third - first)
        position = 2 * second / (math.sqrt(max(0.0, slope * slope - 4 * bend * second)) - slope)
        return HIT, s, leave, s + half * (1 + min(max(position, -1.0), 1.0))
    return ABSENT, s, s, s


@kernel(borrows=True, forceinline=True)
def _too_steep(
    steepness: Singles, slot: int, level: int, j: int, i: int, slope: float, rates: Rates
) -> bool:
    """Whether a path that is above the surface rises too steeply to meet it within a block."""
    n = patch(level, (j & (CELLS - 1)) >> level, (i & (CELLS - 1)) >> level)
    ground = steepness[slot, n, 0] * rates.u + steepness[slot, n, 1] * rates.v
    return ground < slope - rates.slack


@kernel(borrows=True, forceinline=True)
def _start(
    maxima: Singles,
    steepness: Singles,
    slot: int,
    j: int,
    i: int,
    height: float,
    slope: float,
    rates: Rates,
) -> int:
    """Level of a block, nearly the largest, that a rising path leaves without meeting its surface.

    The path is above the surface of the cell [j, i].
    """
    if _too_steep(steepness, slot, SIZE, j, i, slope, rates):
        return SIZE
    level = PATCH - 1
    while _too_steep(steepness, slot, level + 1, j, i, slope, rates):
        level += 1
    if level >= PATCH:
        return level
    level, j, i = 0, j & (CELLS - 1), i & (CELLS - 1)
    while (
        level < SIZE - 1 and maxima[slot, block(level + 1, j >> level + 1, i >> level + 1)] < height
    ):
        level += 1
    return level


@kernel(borrows=True, forceinline=True)
def _over(heights: Singles, path: Path, u0: float, slot: int, j: int, i: int, s: float) -> bool:
    """Whether a path is above the surface of a cell; false in a hole."""
    a, b, c, d = corners(heights, slot, j & (CELLS - 1), i & (CELLS - 1))
    return _clear(path, u0 - i, path.v0 - j, a, b, c, d, s) > 0


@kernel(forceinline=True)
def _clear(
    path: Path, u0: float, v0: float, a: float, b: float, c: float, d: float, s: float
) -> float:
    """Height of a path above a bilinear cell."""
    u, v = u0 + s * (path.u1 + s * path.u2), v0 + s * (path.v1 + s * path.v2)
    return path.h0 + s * (path.h1 + s * path.h2) - (a + b * u + (c + d * u) * v)


@kernel(borrows=True)
def _cell_exact(
    lines: Lattice,
    heights: Singles,
    ray: Ray,
    middle: float,
    piece: Piece,
    s: float,
    leave: float,
    slot: int,
    j: int,
    i: int,
) -> tuple[int, float, float, float]:
    """As `_cell_by_parabola`, with exact heights."""
    half = 0.5 * (leave - s)
    low, high, guess = s, leave, s + half
    first = second = third = 0.0
    for turn in range(4):
        here = guess if turn == 3 else s + turn * half
        path = path_at(lines, ray, middle + here)
        value = above(lines, heights, slot, j, i, path, 0.0)[0]
        if turn == 0 and s > piece.begin and not value >= -CLOSED:
            # Out of a hole or over an edge: the ray gives the position more accurately than the
            # path.
            late = _entry(lines, path, j, i, piece.east, piece.south)
            s += late
            value = above(lines, heights, slot, j, i, path, late)[0]
        if turn == 0 and value <= 0:  # the ray comes from the side or from below
            return HIT, s, s, s
        if value <= 0:
            high = here
            break
        first, second, third = second, third, value
        if turn == 2:
            position = _parabola_minimum(first, second, third)[1]
            if not -1 < position < 1:
                return MISS, math.inf, math.inf, math.inf
            guess = s + half * (1 + position)
    if not value <= 0:
        return MISS, math.inf, math.inf, math.inf
    return HIT, low, high, 0.5 * (low + high)


@kernel
def _entry(lines: Lattice, path: Path, j: int, i: int, east: int, south: int) -> float:
    """Distance from the middle of an exact path to its near entry into a cell; 0 if none."""
    u0 = path.u0 - lines.turn * math.floor((path.u0 - i) / lines.turn + 0.5)
    by_u = (i + (0 if east > 0 else 1) - u0) / path.u1
    by_v = (j + (0 if south > 0 else 1) - path.v0) / path.v1
    nearer = by_u if abs(by_u) < abs(by_v) else by_v
    return nearer if abs(nearer) < JUST else 0.0


@kernel(forceinline=True)
def _parabola_minimum(first: float, second: float, third: float) -> tuple[float, float]:
    """Minimum of the parabola through values at -1, 0 and 1 within [-1, 1], and its position."""
    slope, bend = 0.5 * (third - first), 0.5 * (first + third) - second
    if bend > 0 and abs(slope) < 2 * bend:
        return second - 0.25 * slope * slope / bend, -0.5 * slope / bend
    if first < third:
        return first, -1.0
    return third, 1.0  # NaN gives NaN


@kernel(borrows=True)
def above(
    lines: Lattice, heights: Singles, slot: int, j: int, i: int, path: Path, s: float
) -> tuple[float, float, float]:
    """Height of an exact path above the surface; its derivative with distance; the absolute second
    derivative by the cell's twist.

    The cell near [j, i] that contains the point is used, so that the value is continuous.
    """
    u0 = path.u0 - lines.turn * math.floor((path.u0 - i) / lines.turn + 0.5)
    u = u0 + s * (path.u1 + s * path.u2) - ((i >> SIZE) << SIZE)
    v = path.v0 + s * (path.v1 + s * path.v2) - ((j >> SIZE) << SIZE)
    i = _cell(u, 0, min(CELLS, lines.columns - ((i >> SIZE) << SIZE)) - 1)
    j = _cell(v, 0, min(CELLS, lines.rows - ((j >> SIZE) << SIZE)) - 1)
    a, b, c, d = corners(heights, slot, j, i)
    u, v = u - i, v - j
    to_column, to_row = path.u1 + 2 * s * path.u2, path.v1 + 2 * s * path.v2
    height = path.h0 + s * (path.h1 + s * path.h2)
    change = path.h1 + 2 * s * path.h2 - (b + d * v) * to_column - (c + d * u) * to_row
    return height - (a + b * u + c * v + d * u * v), change, abs(2 * d * to_column * to_row)
