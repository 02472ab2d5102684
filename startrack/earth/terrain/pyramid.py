"""Terrain of any size: each ray uses the level that its resolution needs."""

from dataclasses import dataclass, field

import numpy as np

from startrack.core import Flags, Refused, Singles, finite
from startrack.earth.terrain.constant_height import ConstantHeight
from startrack.earth.terrain.ellipsoid import EQUATORIAL
from startrack.earth.terrain.ground import Levels, Rays
from startrack.earth.terrain.horizon import with_horizon
from startrack.earth.terrain.march import ABSENT
from startrack.earth.terrain.mosaic import Mosaic
from startrack.earth.terrain.sources import Source
from startrack.earth.terrain.surface import FULL_TURN, Grid, Surface, covered
from startrack.earth.terrain.tile import CELLS, Cache, Key
from startrack.earth.terrain.trace import RayHits, go_on, no_hits, waiting


def beside(surface: Surface, wet: RayHits, hits: RayHits) -> RayHits:
    """The same hits; a hit of the sea replaces the hit of a ray that meets the sea first, outside
    the surface."""
    first = wet.hit & (wet.distance < hits.distance) & ~covered(surface, wet.place)
    hits.put(first, wet.of(first))
    return hits


def under(surface: Surface, sea: float | None, rays: Rays, start: float) -> Flags:
    """Whether rays lead into the sea outside the surface, or below the lowest height."""
    deep = ConstantHeight(surface.lowest if sea is None else min(sea, surface.lowest))
    stopped = deep.stops(rays, np.zeros(0, np.int8), start)
    if sea is not None:
        wet, _ = ConstantHeight(sea).meet(rays)
        stopped |= wet.hit & (wet.distance > start) & ~covered(surface, wet.place)
    return stopped


@dataclass(frozen=True, eq=False)
class Pyramid:
    """Terrain that reads only the tiles that rays need.

    terrain          sources of its heights
    sea              metre, height where no source covers the Earth; above the geoid if there is
                     one, else above the ellipsoid
    holes            metre, height of holes inside the sources, likewise; None: rays into holes are
                     refused
    geoid            undulations, for heights above the geoid; None: heights are above the ellipsoid
    lowest, highest  metre above the ellipsoid, bounds of all heights
    tiles            largest number of tiles in memory
    sharpness        1, ground resolution of a ray over the cell size of its level; 1: cells up to a
                     pixel's side; 0: always the finest level
    """

    terrain: Mosaic
    sea: float = 0.0
    geoid: Source | None = None
    lowest: float = -500.0
    highest: float = 9000.0
    tiles: int = 64
    sharpness: float = 1.0
    holes: float | None = None
    cache: Cache = field(init=False)
    _surfaces: dict[int, Surface] = field(default_factory=dict, init=False)
    _holes: dict[Key, Flags] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        finite(sea=self.sea, lowest=self.lowest, highest=self.highest, sharpness=self.sharpness)
        if self.lowest >= self.highest:
            raise ValueError(
                f"highest must be above lowest, got {self.highest:g} and {self.lowest:g} metre"
            )
        object.__setattr__(self, "cache", Cache(self._read, self.tiles))

    def meet(self, rays: Rays) -> tuple[RayHits, Levels]:
        """Points where rays meet the terrain, each ray on one level.

        Raises    OSError if a tile cannot be read; Refused if a height lies beyond the
                  bounds, or a ray meets a hole without a given height.
        Accuracy  model: the resolution of a ray at the sea determines its level.
        """
        wet, out = ConstantHeight(self.sea).meet(rays)[0], no_hits(len(rays))
        level = self.choose(rays, wet)
        for own_level in np.unique(level):
            mine = np.flatnonzero(level == own_level)
            some, surface = rays[mine], self._surface(int(own_level))
            hits = waiting(len(mine), 0.0)
            while self._fetch(int(own_level), hits):
                go_on(surface, some.origin, some.direction, hits, True)
            if self._holes:
                self._require_heights(int(own_level), hits)
            out.put(mine, beside(surface, wet.of(mine), hits))
        return out, level

    def stops(self, rays: Rays, level: Levels, start: float) -> Flags:
        """Whether rays meet the terrain at given levels, the sea, or the Earth below them."""
        out = np.zeros(len(rays), np.bool_)
        for own_level in np.unique(level):
            mine = np.flatnonzero(level == own_level)
            some, surface = rays[mine], self._surface(int(own_level))
            hits = waiting(len(mine), start)
            while self._fetch(int(own_level), hits):
                horizon = with_horizon(surface, some)
                go_on(horizon, some.origin, some.direction, hits, False)
            out[mine] = hits.hit | under(surface, self.sea, some, start)
        return out

    def choose(self, rays: Rays, there: RayHits) -> Levels:
        """The level of each ray, from its resolution at the sea.

        level = floor(log2(sharpness * distance * spread / cell)),  at least the source's level
        """
        seen = there.hit & (rays.spread > 0) & (self.sharpness > 0)
        cell = self.terrain.grid.step_y * EQUATORIAL
        with np.errstate(divide="ignore", invalid="ignore"):
            wanted = np.log2(self.sharpness * there.distance * rays.spread / cell)
        level = np.zeros(len(rays), np.int8)
        level[seen] = np.clip(np.floor(wanted[seen]), 0, self.terrain.levels - 1)
        hit = there.hit
        level[hit] = np.maximum(level[hit], self.terrain.level_of(there.place[hit, :2]))
        return level

    def _fetch(self, level: int, hits: RayHits) -> bool:
        """Load tiles that rays wait for. Returns whether any ray waits.

        A call loads at most half of the cache. So the tiles of the last call stay in memory, and
        the first waiting ray advances with every call.
        """
        self.cache.refresh()
        waiting = np.flatnonzero(hits.status == ABSENT)
        slot = self._surface(level).slot
        tile = hits.tile[waiting].astype(np.int64)
        _, first = np.unique(tile[:, 0] * slot.shape[1] + tile[:, 1], return_index=True)
        # A ray that has not begun does not name a tile yet: -1.
        wanted = [n for n in np.sort(first) if hits.tile[waiting[n]].min() >= 0]
        for n in wanted[: self.cache.capacity // 2]:
            self._load(level, *map(int, tile[n]))
        return len(waiting) > 0

    def _load(self, level: int, j: int, i: int) -> None:
        surface = self._surface(level)
        slot, gone, lowest, highest = self.cache.load((level, j, i))
        if gone:
            self._surface(gone[0]).slot[gone[1:]] = -1
        if not (self.lowest <= lowest and highest <= self.highest):
            raise Refused(
                f"heights must lie in [{self.lowest:g}, {self.highest:g}] metre above the "
                f"ellipsoid, got {lowest:g} to {highest:g}"
            )
        surface.slot[j, i], surface.top[j, i] = slot, highest

    def _read(self, level: int, j: int, i: int) -> Singles:
        """Heights of a tile above the ellipsoid; the sea where sources have none."""
        tile = self.terrain.read(level, j, i)
        window = self.terrain.window(level, j, i)
        if window is None:
            return tile
        part = tile[: window.rows, : window.columns]
        holes = self._fill(part, window)
        if self.holes is None and holes.any():
            self._holes[level, j, i] = holes
        if self.geoid is not None:
            undulation = self.geoid.read(window)
            if np.isnan(undulation).any():
                raise ValueError("geoid must cover all of the terrain, but has no value at some")
            part += undulation
        return tile

    def _fill(self, part: Singles, window: Grid) -> Flags:
        """Fill in heights where no source has a value. Returns the (rows, columns) of holes in
        sources."""
        holes = np.isnan(part)
        v, u = np.nonzero(holes)
        if v.size:
            longitude = np.asarray(window.west + u * window.step_x, float)
            latitude = np.asarray(window.north - v * window.step_y, float)
            holes[v, u] = self.terrain.covers(longitude, latitude)
            inside = self.sea if self.holes is None else self.holes
            part[v, u] = np.where(holes[v, u], inside, self.sea)
        return holes

    def _require_heights(self, level: int, hits: RayHits) -> None:
        """Refuse hits in holes without a given height."""
        grid, hit = self.terrain.grid, np.flatnonzero(hits.hit)
        u = ((hits.place[hit, 0] - grid.west) % FULL_TURN) / grid.step_x / 2.0**level
        v = (grid.north - hits.place[hit, 1]) / grid.step_y / 2.0**level
        met = np.zeros(len(hit), np.bool_)
        for (own_level, j, i), holes in self._holes.items():
            mine = (v // CELLS == j) & (u // CELLS == i) if own_level == level else met[:0]
            if mine.any():
                row = np.minimum((v[mine] - j * CELLS).astype(int), holes.shape[0] - 2)
                column = np.minimum((u[mine] - i * CELLS).astype(int), holes.shape[1] - 2)
                met[mine] = (
                    holes[row, column]
                    | holes[row, column + 1]
                    | holes[row + 1, column]
                    | holes[row + 1, column + 1]
                )
        if met.any():
            longitude, latitude = np.degrees(hits.place[hit[met][0], :2])
            raise Refused(
                f"holes must be given (0 m for a sea): {np.count_nonzero(met)} rays meet ground "
                f"without a height in the files, the first at longitude {longitude:.4f}, "
                f"latitude {latitude:.4f} degree; or fill the holes in the files",
                key="holes",
                rule="must be given",
            )

    def _surface(self, level: int) -> Surface:
        if level not in self._surfaces:
            grid, cells = self.terrain.grid, self.terrain.shape(level)
            tiles = tuple(-(-count // CELLS) for count in cells)
            self._surfaces[level] = Surface(
                west=grid.west,
                north=grid.north,
                step_x=grid.step_x * (1 << level),
                step_y=grid.step_y * (1 << level),
                # Integer bounds would compile the kernels again.
                columns=cells[1],
                rows=cells[0],
                lowest=float(self.lowest),
                highest=float(self.highest),
                heights=self.cache.heights,
                maxima=self.cache.maxima,
                steepness=self.cache.steepness,
                slot=np.full(tiles, -1, np.int32),
                top=np.full(tiles, float(self.highest)),
                used=self.cache.used,
            )
        return self._surfaces[level]
