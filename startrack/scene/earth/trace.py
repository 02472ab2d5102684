"""Rays and a surface -> where they meet it, and with which normal; or only whether they do."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.scene.earth.ellipsoid import ECCENTRICITY_2, EQUATORIAL
from startrack.scene.earth.ground import Rays
from startrack.scene.earth.march import ABSENT, HIT, march
from startrack.scene.earth.surface import FULL_TURN, Surface, corners, locate
from startrack.scene.earth.tile import CELLS, SIZE

Floats = NDArray[np.float64]


class Hits(NamedTuple):
    """Where rays meet a surface; NaN, and infinity as the distance, where they do not.

    status    (n,) MISS, HIT, or ABSENT: the ray waits at `distance` for the tile `tile`
    distance  (n,) metre
    place     (n, 3) longitude and latitude in radian, height in metre
    normal    (n, 3) unit vectors
    tile      (n, 2) row and column of the absent tile; -1 before the ray has begun
    """

    @property
    def hit(self) -> NDArray[np.bool_]:
        """Which rays meet the surface."""
        return self.status == HIT

    def put(self, choice: NDArray[np.intp] | NDArray[np.bool_], other: Hits) -> None:
        """Take the rays of `choice` from other hits, in their order."""
        self.status[choice], self.distance[choice] = other.status, other.distance
        self.place[choice], self.normal[choice] = other.place, other.normal
        self.tile[choice] = other.tile

    def of(self, choice: NDArray[np.intp] | NDArray[np.bool_]) -> Hits:
        """The hits of some rays."""
        return Hits(
            self.status[choice],
            self.distance[choice],
            self.place[choice],
            self.normal[choice],
            self.tile[choice],
        )

    status: NDArray[np.uint8]
    distance: Floats
    place: Floats
    normal: Floats
    tile: NDArray[np.int32]


def trace(surface: Surface, rays: Rays) -> Hits:
    """Find the nearest point at which each ray meets a surface that is in memory.

    The ray is straight; the surface is bilinear in longitude and latitude above WGS84. A ray that
    begins under the surface, or comes under it from its side or out of a hole, ends there.

    Errors   numerical: 1e-8 m of the exact intersection, in the middle 1e-9 m; a ray that grazes
             a ridge within 1e-6 m may be judged on the wrong side. Nothing is ABSENT
             where all tiles are in memory.
    """
    hits = no_hits(len(rays))
    hits.distance[:] = 0.0
    hits.status[:] = ABSENT
    go_on(surface, rays.origin, rays.direction, *hits)
    return hits


def no_hits(count: int) -> Hits:
    """Hits to be filled in."""
    nothing = np.full((count, 3), np.nan)
    return Hits(
        np.zeros(count, np.uint8),
        np.full(count, np.inf),
        nothing,
        nothing.copy(),
        np.full((count, 2), -1, np.int32),
    )


@njit(cache=True, error_model="numpy")
def go_on(surface, origin, direction, status, distance, place, normal, tile):  # type: ignore[no-untyped-def]
    """Follow the rays whose status is ABSENT, from where they are, until they end or wait again."""
    for n in range(len(origin)):
        if status[n] != ABSENT:
            continue
        ox, oy, oz = origin[n]
        dx, dy, dz = direction[n]
        found, s, j, i, where = march(surface, ox, oy, oz, dx, dy, dz, distance[n], True)
        status[n], distance[n] = found, s
        if found == ABSENT:
            tile[n, 0], tile[n, 1] = j, i
        elif found == HIT:
            describe(surface, j, i, ox + s * dx, oy + s * dy, where, place, normal, n)


@njit(cache=True, error_model="numpy")
def describe(surface, tile_j, tile_i, x, y, where, place, normal, n):  # type: ignore[no-untyped-def]
    """Geodetic place of a point of the surface, and the surface's normal there.

    normal ~ up - h_lon / ((N + h) cos(lat)) east - h_lat / (M + h) north
    """
    u, v, height, sine, cosine = where
    across = max(math.sqrt(x * x + y * y), 1e-3)
    west, north = tile_i << SIZE, tile_j << SIZE
    longitude = surface.west + u * surface.step_x
    place[n, 0] = longitude - FULL_TURN * math.floor(longitude / FULL_TURN + 0.5)
    place[n, 1], place[n, 2] = surface.north - v * surface.step_y, height
    turn = FULL_TURN / surface.step_x
    u -= turn * math.floor((u - west - 0.5 * CELLS) / turn + 0.5)
    u, v = u - west, v - north
    i = min(max(math.floor(u), 0), min(CELLS, surface.columns - west) - 1)
    j = min(max(math.floor(v), 0), min(CELLS, surface.rows - north) - 1)
    _, b, c, d = corners(surface.heights, surface.slot[tile_j, tile_i], j, i)
    bend = 1 - ECCENTRICITY_2 * sine * sine
    meridian = EQUATORIAL * (1 - ECCENTRICITY_2) / (bend * math.sqrt(bend))
    lean = -(b + d * (v - j)) / (surface.step_x * across)
    tilt = (c + d * (u - i)) / (surface.step_y * (meridian + height))
    scale = 1 / math.sqrt(1 + lean * lean + tilt * tilt)
    cosine_x, sine_y = x / across, y / across
    radial = cosine - tilt * sine
    normal[n, 0] = scale * (radial * cosine_x - lean * sine_y)
    normal[n, 1] = scale * (radial * sine_y + lean * cosine_x)
    normal[n, 2] = scale * (sine + tilt * cosine)


def blocked(surface: Surface, rays: Rays, start: float) -> NDArray[np.bool_]:
    """Whether each ray meets a surface in memory at all, beyond the distance `start` in metres."""
    hits = no_hits(len(rays))
    hits.status[:], hits.distance[:] = ABSENT, start
    ask_on(surface, rays.origin, rays.direction, hits.status, hits.distance, hits.tile)
    return hits.hit


@njit(cache=True, error_model="numpy")
def ask_on(surface, origin, direction, status, distance, tile):  # type: ignore[no-untyped-def]
    """As `go_on`, but without finding the points."""
    for n in range(len(origin)):
        if status[n] == ABSENT:
            ox, oy, oz = origin[n]
            dx, dy, dz = direction[n]
            status[n], distance[n], tile[n, 0], tile[n, 1], _ = march(
                surface, ox, oy, oz, dx, dy, dz, distance[n], False
            )


@njit(cache=True, error_model="numpy")
def describe_all(surface, point, choice, place, normal):  # type: ignore[no-untyped-def]
    """As `describe`, of (n, 3) points on a surface in memory, where `choice` says so."""
    for n in range(len(point)):
        if not choice[n]:
            continue
        x, y, z = point[n]
        u, v, height, sine, cosine, _ = locate(surface, x, y, z)
        i = min(max(math.floor(u), 0), surface.columns - 1)
        j = min(max(math.floor(v), 0), surface.rows - 1)
        where = (u, v, height, sine, cosine)
        describe(surface, j >> SIZE, i >> SIZE, x, y, where, place, normal, n)
