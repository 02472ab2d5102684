"""The surface through heights on a grid, for hits, normals and shadows.

Between four vertices the height is bilinear in longitude and latitude. A cell with a vertex that
is not a number is a hole.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Singles, finite, kernel, positive, whole
from startrack.earth.terrain.ellipsoid import angle, vertical
from startrack.earth.terrain.tile import BLOCKS, CELLS, PATCHES, VERTICES, fill

FULL_TURN = 2 * math.pi
# fraction of a step; tolerance for a grid that closes around the Earth or reaches a pole
SEAM = 1e-6


@dataclass(frozen=True)
class NorthUp:
    """An array on the ground, north up and west left, evenly spaced.

    west, north      edges of the array
    step_x, step_y   steps to the next column eastwards and to the next row southwards
    columns, rows    number of columns and rows
    """

    west: float
    north: float
    step_x: float
    step_y: float
    columns: int
    rows: int


@dataclass(frozen=True)
class Grid(NorthUp):
    """Vertices of an array of heights, in radian, from the longitude and latitude of [0, 0]."""

    def __post_init__(self) -> None:
        finite(west=self.west, north=self.north)
        positive(step_x=self.step_x, step_y=self.step_y)
        whole(2, 2**31, columns=self.columns, rows=self.rows)
        if (self.columns - 1) * self.step_x > FULL_TURN * (1 + SEAM):
            raise ValueError(
                f"columns must span at most a full turn, got {self.columns} of "
                f"{math.degrees(self.step_x):g} degree"
            )
        if max(self.north, -self.south) > math.pi / 2 + SEAM * self.step_y:
            raise ValueError(
                "rows must lie between the poles, got latitudes from "
                f"{math.degrees(self.south):g} to {math.degrees(self.north):g} degree"
            )

    @property
    def south(self) -> float:
        """Radian, latitude of the last row."""
        return self.north - (self.rows - 1) * self.step_y

    @property
    def closed(self) -> bool:
        """Whether the column after the last one is the first."""
        return abs(self.columns * self.step_x - FULL_TURN) < SEAM * self.step_x

    @property
    def cells_across(self) -> int:
        """Number of cells along a row."""
        return self.columns if self.closed else self.columns - 1


class Horizon(NamedTuple):
    """Heights above which parallel rays meet nothing any more; see `with_horizon`.

    `along` is offset + sign * (row or column), `across` the other coordinate, and aside is across -
    shear * along.

    bound     (blocks along, strips aside) metre; empty where there is no horizon
    by_rows   1 where rays go mostly along rows of cells up or down, else 0
    sign, offset, shear, begin  as above, in cells; strips begin at aside = `begin`
    per_side  blocks per cell
    """

    bound: Singles
    by_rows: int
    sign: float
    offset: float
    shear: float
    begin: float
    per_side: float


NO_HORIZON = Horizon(
    bound=np.zeros((0, 0), np.float32),
    by_rows=0,
    sign=1.0,
    offset=0.0,
    shear=0.0,
    begin=0.0,
    per_side=1.0,
)


class Surface(NamedTuple):
    """The surface as kernels use it: tiles of 512 x 512 cells with the maxima of their blocks.

    A block of level k holds 2**k by 2**k cells; one of level 9 is a tile.

    west, north, step_x, step_y  as in Grid, for the vertex [0, 0] of tile [0, 0]
    columns, rows                cells
    lowest, highest              metre, bounds of all heights
    heights                      (slots, 513, 513) metre, float32
    maxima                       (slots, 87381) metre, of the blocks of each tile
    steepness                    (slots, 5461, 2) metre per column and per row, of blocks of level 3
                                 and more
    slot                         (tiles down, tiles across) index of a tile in `heights`, -1 if
                                 absent
    top                          (tiles down, tiles across) metre, bound of each tile
    used                         (slots,) 1 where a tile was used
    horizon                      horizon of the parallel rays of the call
    """

    west: float
    north: float
    step_x: float
    step_y: float
    columns: int
    rows: int
    lowest: float
    highest: float
    heights: Singles
    maxima: Singles
    steepness: Singles
    slot: NDArray[np.int32]
    top: Floats
    used: NDArray[np.uint8]
    horizon: Horizon = NO_HORIZON


def index(grid: Grid, heights: NDArray[np.floating]) -> Surface:
    """The surface through heights that are all in memory.

    heights  (rows, columns) metre above the ellipsoid; NaN is a hole, through which rays pass
    Returns  the surface with all tiles present; it copies the heights and needs 1.38 times their
             memory where they fill the tiles
    Raises    ValueError if the shape differs from the grid's, a height is infinite, or all
              heights are NaN.
    Accuracy  numerical: heights are kept in single precision, which rounds by 0.3 mm at most up to
              8 km.
    """
    if heights.shape != (grid.rows, grid.columns):
        raise ValueError(
            f"heights must have the shape of their grid, {(grid.rows, grid.columns)}, "
            f"got {heights.shape}"
        )
    heights, north = close(grid, heights.astype(np.float32, copy=False))
    rows, columns = heights.shape[0] - 1, heights.shape[1] - 1
    down, across = -(-rows // CELLS), -(-columns // CELLS)
    tiles = np.full((down * across, VERTICES, VERTICES), np.nan, np.float32)
    maxima = np.empty((down * across, BLOCKS), np.float32)
    steepness = np.empty((down * across, PATCHES, 2), np.float32)
    slot = np.arange(down * across, dtype=np.int32).reshape(down, across)
    top = np.empty((down, across))
    lowest = math.inf
    for (j, i), n in np.ndenumerate(slot):
        part = heights[j * CELLS : j * CELLS + VERTICES, i * CELLS : i * CELLS + VERTICES]
        tiles[n, : part.shape[0], : part.shape[1]] = part
        low, top[j, i] = fill(tiles[n], maxima[n], steepness[n])
        lowest = min(lowest, low)
    highest = float(top.max())
    if not (math.isfinite(lowest) and math.isfinite(highest)):
        raise ValueError(
            f"heights must be finite or NaN, and not all NaN, got {lowest} to {highest}"
        )
    return Surface(
        west=grid.west,
        north=north,
        step_x=grid.step_x,
        step_y=grid.step_y,
        columns=columns,
        rows=rows,
        lowest=lowest,
        highest=highest,
        heights=tiles,
        maxima=maxima,
        steepness=steepness,
        slot=slot,
        top=top,
        used=np.zeros(slot.size, np.uint8),
    )


def close(grid: Grid, heights: Singles) -> tuple[Singles, float]:
    """Add the missing column that closes the turn, and rows at the poles.

    Rows of pixel centres end half a step before the pole. A row is added beyond the pole, so that
    the height at the pole is the mean of the last row from every side.

    Returns  the heights, and the latitude of their first row in radian
    """
    if not grid.closed:
        return heights, grid.north
    north = grid.north
    heights = np.concatenate([heights, heights[:, :1]], axis=1)
    gap = math.pi / 2 - grid.north
    if SEAM * grid.step_y < gap < (1 - SEAM) * grid.step_y:
        heights = np.concatenate([_beyond(heights[:1], gap / grid.step_y), heights])
        north = grid.north + grid.step_y
    gap = math.pi / 2 + grid.south
    if SEAM * grid.step_y < gap < (1 - SEAM) * grid.step_y:
        heights = np.concatenate([heights, _beyond(heights[-1:], gap / grid.step_y)])
    return heights, north


def _beyond(row: Singles, fraction: float) -> Singles:
    mean = row[0, :-1].mean()
    return ((mean - (1 - fraction) * row) / fraction).astype(np.float32)


class Lattice(NamedTuple):
    """The grid of a surface as kernels use it, without the arrays.

    It contains only numbers, which a kernel copies freely; each array of a tuple would cost
    reference counting.

    cosine, sine         of the longitude of the grid's middle
    middle               columns from the west edge to the middle
    north                radian, latitude of the first row
    per_column, per_row  columns and rows per radian
    turn                 columns around the Earth
    columns, rows        cells
    lowest, highest      metre, bounds of all heights
    """

    cosine: float
    sine: float
    middle: float
    north: float
    per_column: float
    per_row: float
    turn: float
    columns: int
    rows: int
    lowest: float
    highest: float


@kernel(borrows=True)
def lattice(surface):  # type: ignore[no-untyped-def]
    """The grid of a surface as a `Lattice`."""
    longitude = surface.west + 0.5 * surface.columns * surface.step_x
    return Lattice(
        math.cos(longitude),
        math.sin(longitude),
        0.5 * surface.columns,
        surface.north,
        1 / surface.step_x,
        1 / surface.step_y,
        FULL_TURN / surface.step_x,
        surface.columns,
        surface.rows,
        surface.lowest,
        surface.highest,
    )


@kernel(forceinline=True)
def locate(lines, x, y, z):  # type: ignore[no-untyped-def]
    """Position of an Earth-fixed point over a grid, at most half a turn from the grid's middle.

    Returns  column and row from the vertex [0, 0], height, sine and cosine of the latitude,
             distance from the axis
    """
    sine, cosine, height, across = vertical(x, y, z)
    east = angle(lines.cosine * y - lines.sine * x, lines.cosine * x + lines.sine * y)
    u = lines.middle + east * lines.per_column
    v = (lines.north - angle(sine, cosine)) * lines.per_row
    return u, v, height, sine, cosine, across


@kernel(borrows=True)
def corners(heights, slot, j, i):  # type: ignore[no-untyped-def]
    """Height = a + b x + c y + d x y within the cell [j, i] of a slot; NaN in a hole."""
    a = float(heights[slot, j, i])
    b = float(heights[slot, j, i + 1]) - a
    c = float(heights[slot, j + 1, i]) - a
    d = float(heights[slot, j + 1, i + 1]) - a - b - c
    return a, b, c, d


@kernel
def covered(surface, place):  # type: ignore[no-untyped-def]
    """Whether places, (n, 3) longitude and latitude in radian and any third, lie over the grid."""
    out = np.zeros(len(place), np.bool_)
    turn = FULL_TURN / surface.step_x
    for n in range(len(place)):
        u = (place[n, 0] - surface.west) / surface.step_x
        u -= turn * math.floor((u - 0.5 * surface.columns) / turn + 0.5)
        v = (surface.north - place[n, 1]) / surface.step_y
        out[n] = 0 <= u <= surface.columns and 0 <= v <= surface.rows
    return out
