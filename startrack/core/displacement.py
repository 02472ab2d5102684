"""Displacement: a smooth field of displacements over a frame, by its values at nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from startrack.core.arrays import Floats
from startrack.core.lagrange import local_weights
from startrack.core.refused import Refused

NODES = 9  # along each side; cubic between them


@dataclass(frozen=True)
class Displacement:
    """By how much more than a camera model says the places of a frame are displaced.

    Between the nodes, which span the frame evenly, the values are cubic polynomials of x and of y;
    beyond it they are those at its edge.
    """

    columns: Annotated[int, "pixel, of the frame"]
    rows: Annotated[int, "pixel, of the frame"]
    value: Annotated[tuple[float, ...], "pixel, 2 NODES^2 numbers: x, then y, each row by row"]

    def __post_init__(self) -> None:
        if len(self.value) != 2 * NODES**2:
            raise Refused(f"value must have {2 * NODES**2} numbers, got {len(self.value)}")

    def __call__(self, pixel: Floats) -> Floats:
        """Pixel (n, 2) at places (n, 2) pixel; NaN where a place is NaN."""
        x, y = np.asarray(pixel, float).T
        there = np.isfinite(x + y)
        first_x, weight_x = local_weights(self._x, np.where(there, x, 0.0))
        first_y, weight_y = local_weights(self._y, np.where(there, y, 0.0))
        near = np.arange(4)
        value = self._table[
            :, (first_y[:, None] + near)[:, :, None], (first_x[:, None] + near)[:, None]
        ]
        moved = np.einsum("cnji,nj,ni->nc", value, weight_y, weight_x)
        return np.where(there[:, None], moved, np.nan)

    @cached_property
    def _table(self) -> Floats:
        return np.array(self.value).reshape(2, NODES, NODES)

    @cached_property
    def _x(self) -> Floats:
        return np.linspace(-0.5, self.columns - 0.5, NODES)

    @cached_property
    def _y(self) -> Floats:
        return np.linspace(-0.5, self.rows - 0.5, NODES)


def node_places(columns: int, rows: int) -> Floats:
    """Places (NODES^2, 2) pixel of the nodes of a frame, row by row."""
    x = np.linspace(-0.5, columns - 0.5, NODES)
    y = np.linspace(-0.5, rows - 0.5, NODES)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
