"""What maps are made of: anything that gives values at the vertices of a grid, such as an array."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from startrack.scene.earth.surface import FULL_TURN, Grid

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


class Source(Protocol):
    """A map of one quantity over a part of the Earth."""

    @property
    def grid(self) -> Grid:
        """Its own vertices, or those that serve it best."""
        ...

    def read(self, grid: Grid) -> Singles:
        """Its values at the vertices of another grid, smoothed to that one's steps.

        Returns  (rows, columns); NaN where it has none
        """
        ...


@dataclass(frozen=True, eq=False)
class Array:
    """A map in memory.

    grid    its vertices
    values  (rows, columns); NaN is no value
    """

    grid: Grid
    values: Singles

    def __post_init__(self) -> None:
        if self.values.shape != (self.grid.rows, self.grid.columns):
            raise ValueError(
                f"values must have the shape of their grid, {(self.grid.rows, self.grid.columns)}, "
                f"got {self.values.shape}"
            )

    @cached_property
    def levels(self) -> list[Singles]:
        """The pyramid: each level at every second vertex of the one before."""
        levels = [self.values.astype(np.float32)]
        while min(levels[-1].shape) > 2:
            levels.append(halve(levels[-1]))
        return levels

    def read(self, grid: Grid) -> Singles:
        """Bilinear in the finest level whose steps are not half of those that are asked for."""
        ratio = max(grid.step_x / self.grid.step_x, grid.step_y / self.grid.step_y)
        level = min(max(0, int(np.floor(np.log2(ratio) + 1e-6))), len(self.levels) - 1)
        values, scale = self.levels[level], 2.0**level
        turn = FULL_TURN / self.grid.step_x
        mine = self.grid
        u = _steps(grid.west - mine.west, grid.step_x, grid.columns) / mine.step_x
        u -= turn * np.floor((u - (mine.columns - 1) / 2) / turn + 0.5)
        v = _steps(mine.north - grid.north, grid.step_y, grid.rows) / mine.step_y
        return bilinear(values, v[:, None] / scale, u[None] / scale, self.grid.closed)


def _steps(first: float, step: float, count: int) -> Floats:
    return first + np.arange(count, dtype=np.float64) * step


def halve(values: Singles) -> Singles:
    """Every second vertex, as a mean with its neighbours weighted 1, 2, 1 along both axes.

    What has no value is left out of the mean. A grid of an even number of vertices loses its
    outermost one.
    """
    known = np.isfinite(values)
    total, weight = np.where(known, values, 0).astype(np.float64), known.astype(np.float64)
    for axis in (0, 1):
        total, weight = (_tent(one, axis) for one in (total, weight))
    with np.errstate(invalid="ignore", divide="ignore"):
        return (total / weight).astype(np.float32)


def _tent(values: Floats, axis: int) -> Floats:
    values = np.moveaxis(values, axis, 0)
    padded = np.concatenate([values[1:2], values, values[-2:-1]])
    out = 0.25 * padded[:-2:2] + 0.5 * values[::2] + 0.25 * padded[2::2]
    return np.moveaxis(out, 0, axis)


def bilinear(
    values: Singles, v: Floats, u: Floats, closed: bool = False, exact: bool = False
) -> Singles:
    """Values between vertices, at rows v and columns u that broadcast; NaN beyond the edges.

    exact  whether to take the nearest vertex instead
    """
    rows, columns = values.shape
    slack = 1e-6  # of a step, so that rounding does not lose the vertices of an edge
    inside = (v >= -slack) & (v <= rows - 1 + slack) & (closed | (u >= -slack))
    inside = inside & (closed | (u <= columns - 1 + slack))
    u = u % columns if closed else np.clip(u, 0, columns - 1)
    v = np.clip(v, 0, rows - 1)
    j = np.clip(np.floor(v).astype(np.int64), 0, rows - 2)
    i = np.clip(np.floor(u).astype(np.int64), 0, columns - (1 if closed else 2))
    after = (i + 1) % columns
    y, x = v - j, u - i
    if exact:
        y, x = np.round(y), np.round(x)
    out = np.zeros(np.broadcast_shapes(v.shape, u.shape))
    for row, column, share in (
        (j, i, (1 - y) * (1 - x)), (j, after, (1 - y) * x),
        (j + 1, i, y * (1 - x)), (j + 1, after, y * x),
    ):  # fmt: skip
        # A vertex without a share has no say, be it a hole.
        out += np.where(share > 1e-9, values[row, column] * share, 0.0)
    return np.where(inside, out, np.nan).astype(np.float32)
