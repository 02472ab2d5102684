"""Elements of a detector, and the times of its lines.

As in orekit's Rugged, the times of lines and the elements do not depend on each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from startrack.core import FINITE, Floats, Parameters, finite, positive, whole


@dataclass(frozen=True)
class Dating(Parameters):
    """When each line of the image is taken.

        time = start + line * period

    Lines are read at even times.
    """

    start: Annotated[float, FINITE, "second after the epoch"] = 0.0
    period: Annotated[float, FINITE,
        "second from line to line; 0 for a matrix, whose lines are all taken at once"
    ] = 0.0  # fmt: skip

    def at(self, line: Floats) -> Floats:
        """Seconds after the epoch, (n,), of lines (n,), also between whole ones."""
        return self.start + line * self.period


@dataclass(frozen=True, eq=False)
class Elements:
    """Positions on the camera's pixel grid of the elements that make one line of the image."""

    x: Annotated[Floats,
        "(columns, stages) pixel, of each column of the image; the charges or numbers of all "
        "stages are added"]  # fmt: skip
    y: Annotated[Floats,
        "(columns, stages) pixel, of each column of the image; the charges or numbers of all "
        "stages are added"]  # fmt: skip
    delay: Annotated[Floats,
        "(columns, stages) lines by which a stage is exposed later than the line"]  # fmt: skip


def line_elements(columns: int, y: float) -> Elements:
    """One row of pixels at the row `y` of the camera."""
    whole(1, 2**20, columns=columns)
    finite(y=y)
    x = np.arange(float(columns))[:, None]
    return Elements(x, np.full_like(x, y), np.zeros_like(x))


def staggered_elements(
    columns: int, y: float, rows_apart: float, forwards: int = -1, lines_a_pixel: float = 2.0
) -> Elements:
    """Two rows, the second shifted by half a pixel, whose pixels alternate in the image.

    The rows see a point on the ground at different times; the image combines them so that it is in
    the same line of both.

    columns        of the image, twice those of a row
    rows_apart     pixel from the first row to the second
    forwards       1 where the ground moves to larger rows, -1 where it moves to smaller ones, as it
                   does below a Pointing
    lines_a_pixel  in which the ground moves by a pixel: 2 for equal sampling along and
                   across
    """
    whole(2, 2**20, columns=columns)
    finite(y=y, rows_apart=rows_apart)
    positive(lines_a_pixel=lines_a_pixel)
    second = np.arange(float(columns))[:, None] % 2
    x = np.arange(float(columns))[:, None] / 2
    return Elements(x, y + rows_apart * second, forwards * rows_apart * lines_a_pixel * second)


def tdi_elements(columns: int, y: float, stages: int, forwards: int = -1) -> Elements:
    """Rows whose charge moves with the image: stage s is s rows farther, exposed s lines later.

    forwards  as for staggered elements
    """
    whole(1, 2**20, columns=columns)
    whole(1, 4096, stages=stages)
    stage = np.arange(float(stages)) - (stages - 1) / 2
    x = np.broadcast_to(np.arange(float(columns))[:, None], (columns, stages)).copy()
    return Elements(x, y + stage + 0 * x, forwards * stage + 0 * x)


def matrix_elements(columns: int, rows: int) -> list[Elements]:
    """The rows of a matrix, one for each line of the image."""
    whole(1, 2**20, rows=rows)
    return [line_elements(columns, float(row)) for row in range(rows)]


def together(lines: list[Elements]) -> Elements:
    """The elements of several lines as those of one, line after line."""
    return Elements(
        np.concatenate([one.x for one in lines]),
        np.concatenate([one.y for one in lines]),
        np.concatenate([one.delay for one in lines]),
    )


def inside_pixel(side: int) -> Floats:
    """Offsets (side^2, 2) pixel of rays that divide a pixel evenly."""
    positive(side=side)
    at = (np.arange(side) + 0.5) / side - 0.5
    return np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
