"""Pattern: noise that the pixels of a row or of a column share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from startrack.core import Floats, Streams, Unit, non_negative


@dataclass(frozen=True)
class Pattern:
    """Normal offsets, which add to the signal of whole rows and columns.

    Source: EMVA 1288 release 4.0, section 2.3 (row and column variances).

    row            electron rms, drawn anew for each frame
    column         electron rms, drawn anew for each frame
    column_offset  electron rms over the columns, the same in all frames of a device
    """

    row: Annotated[float, Unit("electron")] = 0.0
    column: Annotated[float, Unit("electron")] = 0.0
    column_offset: Annotated[float, Unit("electron")] = 0.0

    def __post_init__(self) -> None:
        non_negative(row=self.row, column=self.column, column_offset=self.column_offset)


def offsets(
    pattern: Pattern, shape: tuple[int, int], device: Streams, streams: Streams
) -> tuple[Floats, Floats]:
    """What to add to each row (rows, 1) and to each column (columns,), electron."""
    rows, columns = shape
    down, across = np.zeros((rows, 1)), np.zeros(columns)
    if pattern.row:
        down += pattern.row * streams("row noise").standard_normal((rows, 1))
    if pattern.column:
        across += pattern.column * streams("column noise").standard_normal(columns)
    if pattern.column_offset:
        across += pattern.column_offset * device("column offset").standard_normal(columns)
    return down, across
