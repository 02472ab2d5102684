"""Points and normals where rays meet a surface in memory; or only whether they meet it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Flags, Floats, Ints, kernel, printed
from startrack.earth.terrain import bundle as of
from startrack.earth.terrain.bundle import (
    WIDTH,
    empty_bundle,
    lay_all,
    normal_at,
    ray_of,
    refine_all,
    segment_of,
    settle,
)
from startrack.earth.terrain.ground import Rays
from startrack.earth.terrain.horizon import with_horizon
from startrack.earth.terrain.march import ABSENT, HIT, MISS, march
from startrack.earth.terrain.path import point_at
from startrack.earth.terrain.surface import FULL_TURN, Lattice, Surface, corners, lattice, locate
from startrack.earth.terrain.tile import CELLS, SIZE


@printed
class RayHits(NamedTuple):
    """Points where rays meet a surface; for other rays NaN, with infinity as the distance.

    status    (n,) MISS, HIT, or ABSENT: the ray waits at `distance` for the tile `tile`
    distance  (n,) metre
    place     (n, 3) longitude and latitude in radian, height in metre
    normal    (n, 3) unit vectors
    tile      (n, 2) row and column of the absent tile; -1 before the ray has begun
    """

    @property
    def hit(self) -> Flags:
        """Rays that meet the surface."""
        return self.status == HIT

    def put(self, choice: NDArray[np.intp] | Flags, other: RayHits) -> None:
        """Replace the rays of `choice` by other hits, in their order."""
        pairs: Any = zip(self, other, strict=True)
        for mine, theirs in pairs:
            mine[choice] = theirs

    def of(self, choice: NDArray[np.intp] | Flags) -> RayHits:
        """The hits of some rays."""
        return RayHits._make(values[choice] for values in self)

    status: NDArray[np.uint8]
    distance: Floats
    place: Floats
    normal: Floats
    tile: NDArray[np.int32]


def trace(surface: Surface, rays: Rays) -> RayHits:
    """Find the nearest point at which each ray meets a surface that is in memory.

    The ray is straight; the surface is bilinear in longitude and latitude above WGS84. A ray that
    begins under the surface, or gets below it through its side or a hole, ends there.

    Accuracy  numerical: within 1e-8 m of the exact intersection, typically 1e-9 m; a ray that
              grazes a ridge within 1e-6 m may be put on the wrong side. Nothing is ABSENT where all
              tiles are in memory.
    """
    hits = waiting(len(rays), 0.0)
    go_on(surface, rays.origin, rays.direction, hits, True)
    return hits


def waiting(count: int, start: float) -> RayHits:
    """Hits of rays before the search, for `go_on` to fill in; `start` in metres."""
    place, normal = np.full((2, count, 3), np.nan)
    tile = np.full((count, 2), -1, np.int32)
    return RayHits(np.full(count, ABSENT, np.uint8), np.full(count, start), place, normal, tile)


def no_hits(count: int) -> RayHits:
    """Hits of rays that meet nothing."""
    return waiting(count, np.inf)._replace(status=np.full(count, MISS, np.uint8))


@kernel
def go_on(surface: Surface, origin: Floats, direction: Floats, hits: RayHits, exact: bool) -> None:
    """Follow the rays whose status is ABSENT until they end or need another absent tile.

    exact  whether to find their points and normals
    """
    lines, bundle, who = lattice(surface), empty_bundle(), np.empty(WIDTH, np.int64)
    n = np.int64(0)  # a literal would let numba compile `_gather` again
    while n < len(origin):
        n, count = _gather(bundle, who, n, origin, direction, hits)
        lay_all(bundle, lines, exact)
        _march_all(surface, lines, bundle, who[:count], hits, exact)
        if exact:
            refine_all(bundle, lines)
            _describe_all(surface, lines, bundle, who[:count], hits)


@kernel(borrows=True)
def _gather(
    bundle: Floats, who: Ints, n: int, origin: Floats, direction: Floats, hits: RayHits
) -> tuple[int, int]:
    """Fill a bundle with waiting rays from number n on. Returns the next number and the count of
    rays."""
    status, distance, count = hits.status, hits.distance, 0
    while n < len(origin) and count < WIDTH:
        if status[n] == ABSENT:
            who[count] = n
            bundle[of.OX + count] = origin[n, 0]
            bundle[of.OY + count] = origin[n, 1]
            bundle[of.OZ + count] = origin[n, 2]
            bundle[of.DX + count] = direction[n, 0]
            bundle[of.DY + count] = direction[n, 1]
            bundle[of.DZ + count] = direction[n, 2]
            bundle[of.START + count] = distance[n]
            count += 1
        n += 1
    return n, count


@kernel(borrows=True)
def _march_all(
    surface: Surface, lines: Lattice, bundle: Floats, who: Ints, hits: RayHits, exact: bool
) -> None:
    """Follow each ray of a bundle to a cell; the cell's corners replace the ray's path."""
    status, distance, tile = hits.status, hits.distance, hits.tile
    for k in range(len(who)):
        n = who[k]
        begin, end = bundle[of.BEGIN + k], bundle[of.END + k]
        if not begin < end:
            status[n], distance[n] = MISS, math.inf
            continue
        status[n], low, high, guess, j, i = march(
            lines, surface, ray_of(bundle, k), segment_of(bundle, k), begin, end
        )
        distance[n] = guess
        if status[n] == ABSENT:
            tile[n, 0], tile[n, 1] = j, i
        elif status[n] == HIT and exact:
            bundle[of.GUESS + k], bundle[of.LOW + k], bundle[of.HIGH + k] = guess, low, high
            bundle[of.COLUMN + k], bundle[of.ROW + k] = i, j
            slot = surface.slot[j >> SIZE, i >> SIZE]
            a, b, c, d = corners(surface.heights, slot, j & (CELLS - 1), i & (CELLS - 1))
            # the ray comes from the side, not from above
            bundle[of.A + k] = a if low < high else math.nan
            bundle[of.B + k], bundle[of.C + k], bundle[of.D + k] = b, c, d


@kernel(borrows=True)
def _describe_all(
    surface: Surface, lines: Lattice, bundle: Floats, who: Ints, hits: RayHits
) -> None:
    """Point and normal of each ray that hit; `settle` finds the points that `refine` does not."""
    status, distance, place, normal = hits.status, hits.distance, hits.place, hits.normal
    for k in range(len(who)):
        n = who[k]
        if status[n] == MISS:
            place[n, :] = math.nan
            normal[n, :] = math.nan
        if status[n] != HIT:
            continue
        if not np.isnan(bundle[of.FOUND + k]):
            distance[n] = bundle[of.FOUND + k]
            _put_place(surface, bundle[of.U + k], bundle[of.V + k], place[n])
            place[n, 2] = bundle[of.HEIGHT + k]
            normal[n, 0] = bundle[of.NX + k]
            normal[n, 1] = bundle[of.NY + k]
            normal[n, 2] = bundle[of.NZ + k]
            continue
        j, i = int(bundle[of.ROW + k]), int(bundle[of.COLUMN + k])
        ray, slot = ray_of(bundle, k), surface.slot[j >> SIZE, i >> SIZE]
        distance[n], over = settle(
            lines,
            surface.heights,
            ray,
            slot,
            j,
            i,
            bundle[of.LOW + k],
            bundle[of.HIGH + k],
            bundle[of.GUESS + k],
        )
        x, y, _ = point_at(ray, distance[n])
        _describe(surface, lines, j >> SIZE, i >> SIZE, x, y, over, place[n], normal[n])


@kernel(borrows=True, forceinline=True)
def _put_place(surface: Surface, u: float, v: float, place: Floats) -> None:
    longitude = surface.west + u * surface.step_x
    place[0] = longitude - FULL_TURN * math.floor(longitude / FULL_TURN + 0.5)
    place[1] = surface.north - v * surface.step_y


@kernel(borrows=True)
def _describe(
    surface: Surface,
    lines: Lattice,
    tile_j: int,
    tile_i: int,
    x: float,
    y: float,
    over: tuple[float, float, float, float, float],
    place: Floats,
    normal: Floats,
) -> None:
    """Fill in the geodetic coordinates and the normal of a point of the surface in a tile."""
    u, v, height, sine, cosine = over
    _put_place(surface, u, v, place)
    place[2] = height
    west, north = tile_i << SIZE, tile_j << SIZE
    u -= lines.turn * math.floor((u - west - 0.5 * CELLS) / lines.turn + 0.5)
    u, v = u - west, v - north
    i = min(max(math.floor(u), 0), min(CELLS, surface.columns - west) - 1)
    j = min(max(math.floor(v), 0), min(CELLS, surface.rows - north) - 1)
    _, b, c, d = corners(surface.heights, surface.slot[tile_j, tile_i], j, i)
    normal[0], normal[1], normal[2] = normal_at(
        lines, x, y, height, sine, cosine, b + d * (v - j), c + d * (u - i)
    )


def blocked(surface: Surface, rays: Rays, start: float) -> Flags:
    """Whether each ray meets a surface in memory at all, beyond the distance `start` in metres."""
    hits = waiting(len(rays), start)
    go_on(with_horizon(surface, rays), rays.origin, rays.direction, hits, False)
    return hits.hit


@kernel
def describe_all(surface, point, choice, place, normal):  # type: ignore[no-untyped-def]
    """Place and normal of (n, 3) points on a surface in memory, where `choice` says so."""
    lines = lattice(surface)
    for n in range(len(point)):
        if not choice[n]:
            continue
        x, y, z = point[n]
        u, v, height, sine, cosine, _ = locate(lines, x, y, z)
        i = min(max(math.floor(u), 0), surface.columns - 1)
        j = min(max(math.floor(v), 0), surface.rows - 1)
        over = u, v, height, sine, cosine
        _describe(surface, lines, j >> SIZE, i >> SIZE, x, y, over, place[n], normal[n])
