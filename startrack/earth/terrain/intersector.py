"""What can be asked of any ground: where rays meet it, and which rays it stops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from startrack.core import finite
from startrack.earth.terrain.ground import Rays
from startrack.earth.terrain.level import meet_level
from startrack.earth.terrain.march import HIT, MISS
from startrack.earth.terrain.scan import scan
from startrack.earth.terrain.surface import Grid, Surface, covered, index
from startrack.earth.terrain.trace import Hits, blocked, describe_all, no_hits, trace

Flags = NDArray[np.bool_]
Levels = NDArray[np.int8]


class Intersector(Protocol):
    """A ground."""

    def meet(self, rays: Rays) -> tuple[Hits, Levels]:
        """Where rays meet it, and the (n,) levels of its pyramid that were asked."""
        ...

    def stops(self, rays: Rays, level: Levels, start: float) -> Flags:
        """Which rays meet it beyond the distance `start` in metres, at (n,) levels."""
        ...


@dataclass(frozen=True)
class Level:
    """The surface of one height in metres above the ellipsoid: 0 is the ellipsoid alone."""

    height: float = 0.0

    def __post_init__(self) -> None:
        finite(height=self.height)

    def meet(self, rays: Rays) -> tuple[Hits, Levels]:
        """As `meet_level`."""
        return meet_level(rays, self.height), np.zeros(len(rays), np.int8)

    def stops(self, rays: Rays, level: Levels, start: float) -> Flags:
        """Rays that begin on the surface are stopped where they lead under it."""
        moved = Rays(rays.origin + start * rays.direction, rays.direction, rays.spread)
        return meet_level(moved, self.height).hit


@dataclass(frozen=True, eq=False)
class Relief:
    """One surface in memory, and the sea around it.

    sea  metre above the ellipsoid beyond the edges of the surface; None for nothing
    """

    surface: Surface
    sea: float | None = None

    def meet(self, rays: Rays) -> tuple[Hits, Levels]:
        """As `trace`, or the sea where that is nearer and not below the surface."""
        hits = trace(self.surface, rays)
        return beside(self.surface, self.sea, rays, hits), np.zeros(len(rays), np.int8)

    def stops(self, rays: Rays, level: Levels, start: float) -> Flags:
        """As `blocked`; the sea stops rays too, and so does the Earth under all heights."""
        return blocked(self.surface, rays, start) | under(self.surface, self.sea, rays, start)


def beside(surface: Surface, sea: float | None, rays: Rays, hits: Hits) -> Hits:
    """The same hits, changed to the sea where a ray meets that first, beside the surface."""
    if sea is None:
        return hits
    wet = meet_level(rays, sea)
    first = wet.hit & (wet.distance < hits.distance) & ~covered(surface, wet.place)
    hits.put(first, wet.of(first))
    return hits


def under(surface: Surface, sea: float | None, rays: Rays, start: float) -> Flags:
    """Which rays lead into the sea beside the surface, or lower than all of it."""
    deep = Level(surface.lowest if sea is None else min(sea, surface.lowest))
    stopped = deep.stops(rays, np.zeros(0, np.int8), start)
    if sea is not None:
        wet = meet_level(rays, sea)
        stopped |= wet.hit & (wet.distance > start) & ~covered(surface, wet.place)
    return stopped


@dataclass(frozen=True, eq=False)
class Scan:
    """The reference: every cell is searched between two distances in metres along each ray."""

    grid: Grid
    heights: NDArray[np.floating]
    start: float
    stop: float

    def meet(self, rays: Rays) -> tuple[Hits, Levels]:
        """As `scan`."""
        hits = no_hits(len(rays))
        heights = self.heights.astype(np.float32)
        hits.distance[:] = scan(self.grid, heights, rays, self.start, self.stop)
        hits.status[:] = np.where(np.isfinite(hits.distance), HIT, MISS)
        point = rays.origin + np.where(hits.hit, hits.distance, np.nan)[:, None] * rays.direction
        describe_all(index(self.grid, heights), point, hits.hit, hits.place, hits.normal)
        return hits, np.zeros(len(rays), np.int8)

    def stops(self, rays: Rays, level: Levels, start: float) -> Flags:
        """As `scan`, from `start` on over the same length."""
        length = self.stop - self.start
        return np.isfinite(scan(self.grid, self.heights, rays, start, start + length))
