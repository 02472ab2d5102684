"""A surface and parallel rays -> heights above which they can no longer meet it."""

import math

import numpy as np

from startrack.core import Floats, Singles
from startrack.earth.terrain.ellipsoid import cartesian, geodetic
from startrack.earth.terrain.ground import Rays
from startrack.earth.terrain.surface import FULL_TURN, Horizon, Surface
from startrack.earth.terrain.tile import BLOCKS, CELLS, SIZE

FEWEST = 20_000  # rays; for more rays the sweep saves time; measured
HIGHEST = 25.0  # degree of elevation; steeper rays leave the terrain soon; measured
FINEST, COARSEST = 2, 5  # levels of the blocks; measured
MOST_BLOCKS = 2**17  # largest number of blocks of a grid; larger grids have larger blocks
STEP = 100.0  # metre along a ray, base of its slopes
PLACES = 5  # points along each side of the grid for the slopes
SLACK = 2.0  # factor of the slopes' range, for rays between the points
STEEPEST = 1.5  # largest number of cells aside for a cell along
WIDEST = 0.5  # radian, widest grid; a tenth of it is the least distance from the poles
ROUNDING = 0.01  # metre, above the rounding of single precision


def with_horizon(surface: Surface, rays: Rays) -> Surface:
    """The surface with the horizon of many parallel rays; unchanged where a horizon would not save
    time.

    Rays that rise are swept over blocks of cells in strips along their direction, from the last
    column of blocks to the first,

        bound_I = max(M_I, enter_(I+1)),   enter_I = max(M_I, enter_(I+1) - rise),

    M is the maximum of the blocks below a strip, `rise` the least rise of a ray in a column. A ray
    in column I above the bound of its strip meets nothing any more. Strips are widened by the
    largest deviation of rays from straight lines of columns and rows over the longest shadow.
    Blocks are at least as large as that deviation.

    Accuracy  numerical: the slopes of the rays are taken at 50 places of the grid, with twice their
              range; shadows are the same with and without.
    """
    direction = rays.direction
    if len(rays) < FEWEST or (direction != direction[0]).any():
        return surface
    slopes = _slopes(surface, direction[0])
    if slopes is None:
        return surface
    by_rows, sign, shear, bend, rise = slopes
    most_along = surface.rows if by_rows else surface.columns
    drift = bend * min((surface.highest - surface.lowest) / rise, float(most_along + CELLS))
    level = max(FINEST, math.ceil(math.log2(max(drift, 1.0))))
    while (surface.columns >> level) * (surface.rows >> level) > MOST_BLOCKS and level < SIZE:
        level += 1
    if level > COARSEST:
        return surface
    maxima = _maxima(surface, level)
    maxima = maxima if by_rows else maxima.T
    maxima = maxima if sign > 0 else maxima[::-1]
    side, (many, wide) = 1 << level, maxima.shape
    # Strips k: begin + k side <= across - shear * along < begin + (k + 1) side.
    begin = min(0.0, -shear * many * side) - side
    strips = math.ceil(wide + abs(shear) * many) + 3
    bound = np.empty((many, strips), np.float32)
    enter = np.full(strips, -np.inf)
    for column in range(many - 1, -1, -1):
        edges = np.array([column, column + 1]) * shear * side + begin
        first = math.floor((edges.min() - drift) / side)
        count = math.floor((edges.max() + side + drift) / side) - first + 1
        under = np.full(strips + count - 1, -np.inf)
        low, high = max(-first, 0), min(wide - first, len(under))
        if low < high:
            under[low:high] = maxima[column, first + low : first + high]
        highest = under[:strips]
        for n in range(1, count):
            highest = np.maximum(highest, under[n : n + strips])
        bound[column] = np.maximum(highest, enter) + ROUNDING
        enter = np.maximum(highest, enter - rise * side)
    offset = 0.0 if sign > 0 else float(many * side)
    horizon = Horizon(
        bound=bound,
        by_rows=int(by_rows),
        sign=sign,
        offset=offset,
        shear=shear,
        begin=begin,
        per_side=1 / side,
    )
    return surface._replace(horizon=horizon)


def _slopes(surface: Surface, direction: Floats) -> tuple[bool, float, float, float, float] | None:
    """Slopes of parallel rays over a grid, in cells along their main direction and across it.

    Returns  whether the main direction is from row to row; its sign; cells across per cell along:
             mean and largest deviation from the mean; least rise per cell along, metre. None where
             rays do not rise everywhere, rise steeply, or change their main direction
    """
    across, down = surface.columns * surface.step_x, surface.rows * surface.step_y
    if max(across, down) > min(WIDEST, FULL_TURN / 2):
        return None
    u, v, height = np.meshgrid(
        np.linspace(0, surface.columns, PLACES),
        np.linspace(0, surface.rows, PLACES),
        [surface.lowest, surface.highest],
    )
    longitude, latitude = surface.west + u * surface.step_x, surface.north - v * surface.step_y
    if np.abs(latitude).max() > math.pi / 2 - WIDEST / 10:
        return None
    ahead = geodetic(cartesian(longitude, latitude, height) + STEP * direction)
    turn = (ahead[0] - longitude + math.pi) % (2 * math.pi) - math.pi
    columns, rows = turn / surface.step_x / STEP, (latitude - ahead[1]) / surface.step_y / STEP
    rise = (ahead[2] - height) / STEP
    by_rows = bool(np.abs(rows).mean() > np.abs(columns).mean())
    main, aside = (rows, columns) if by_rows else (columns, rows)
    sign = 1.0 if main.mean() > 0 else -1.0
    main = main * sign
    if main.min() <= 0 or not 0 < rise.min() <= rise.max() < math.sin(math.radians(HIGHEST)):
        return None
    slope, steep = aside / main, rise / main
    shear, least = float(slope.mean()), float(steep.min() - (SLACK - 1) * np.ptp(steep))
    if np.abs(slope).max() > STEEPEST or least <= 0:
        return None
    return by_rows, sign, shear, SLACK * float(np.abs(slope - shear).max()), least


def _maxima(surface: Surface, level: int) -> Singles:
    """Maxima of all blocks of a level, (blocks down, blocks across); bounds of absent tiles."""
    side = CELLS >> level
    first = BLOCKS - (4 ** (SIZE + 1 - level) - 1) // 3
    down, across = surface.slot.shape
    out = np.empty((down, side, across, side), np.float32)
    for (j, i), slot in np.ndenumerate(surface.slot):
        out[j, :, i] = surface.top[j, i]
        if slot >= 0:
            out[j, :, i] = surface.maxima[slot, first : first + side * side].reshape(side, side)
    rows, columns = (-(-count >> level) for count in (surface.rows, surface.columns))
    return out.reshape(down * side, across * side)[:rows, :columns]
