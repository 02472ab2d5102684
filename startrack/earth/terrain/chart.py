"""Values on the ground of the maps that accompany the terrain: albedo, temperature, land cover."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, positive, whole
from startrack.earth.terrain.ground import Ground
from startrack.earth.terrain.mosaic import Mosaic
from startrack.earth.terrain.sources import bilinear
from startrack.earth.terrain.surface import FULL_TURN
from startrack.earth.terrain.tile import CELLS

Singles = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Chart:
    """One map of the ground, in the same pyramid of tiles as the terrain.

    mosaic  its sources
    exact   whether its values are classes: then the nearest one on the finest level is used,
            else a bilinear mean on the level whose cells are as large as the terrain's
    absent  value where no source has any
    tiles   that fit into memory
    """

    mosaic: Mosaic
    exact: bool = False
    absent: float = math.nan
    tiles: int = 64
    _read: Callable[[int, int, int], Singles] = field(init=False)

    def __post_init__(self) -> None:
        whole(1, 2**16, tiles=self.tiles)
        object.__setattr__(self, "_read", lru_cache(self.tiles)(self.mosaic.read))

    def at(self, longitude: Floats, latitude: Floats, cell: Floats) -> Floats:
        """Values (n,) at (n,) points in radian, smoothed over (n,) cells in radian."""
        grid = self.mosaic.grid
        out = np.full(len(longitude), self.absent)
        level = np.zeros(len(longitude), np.int64)
        if not self.exact:
            coarse = np.floor(np.log2(cell / grid.step_y) + 1e-6)
            level = np.clip(coarse, 0, self.mosaic.levels - 1).astype(np.int64)
        for each in np.unique(level):
            mine = np.flatnonzero(level == each)
            u = ((longitude[mine] - grid.west) % FULL_TURN) / grid.step_x / 2.0**each
            v = (grid.north - latitude[mine]) / grid.step_y / 2.0**each
            self._fill(out, mine, int(each), v, u)
        return out

    def _fill(self, out: Floats, mine: NDArray[np.intp], level: int, v: Floats, u: Floats) -> None:
        down, across = self.mosaic.shape(level)
        over = (v >= 0) & (v <= down) & (u <= across)
        mine, v, u = mine[over], v[over], u[over]
        j = np.minimum(v // CELLS, -(-down // CELLS) - 1).astype(np.int64)
        i = np.minimum(u // CELLS, -(-across // CELLS) - 1).astype(np.int64)
        for tile_j, tile_i in {*zip(j.tolist(), i.tolist(), strict=True)}:
            part = (j == tile_j) & (i == tile_i)
            tile = self._read(level, tile_j, tile_i)
            values = bilinear(
                tile, v[part] - tile_j * CELLS, u[part] - tile_i * CELLS, exact=self.exact
            )
            out[mine[part]] = np.where(np.isnan(values), self.absent, values)


def read_charts(ground: Ground, charts: dict[str, Chart], cell: float) -> Ground:
    """The same ground with the values of maps; NaN for the sky.

    cell  radian, of the terrain's finest level
    """
    positive(cell=cell)
    hit = ground.hit
    maps = dict(ground.maps)
    for name, chart in charts.items():
        maps[name] = np.full(len(ground), np.nan)
        maps[name][hit] = chart.at(
            ground.longitude[hit],
            ground.latitude[hit],
            cell * np.exp2(ground.level[hit], dtype=float),
        )
    return replace(ground, maps=maps)
