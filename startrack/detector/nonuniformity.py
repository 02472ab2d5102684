"""Defects, Pattern: what differs between pixels, and between rows and columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from startrack.core import NON_NEGATIVE, Floats, Parameters, Range, Streams, Unit


@dataclass(frozen=True)
class Defects(Parameters):
    """Pixels with deviating dark current or response, fixed for each device.

        dark current = max(mean + dsnu N(0, 1), 0) + (hot: exponential of mean hot_current)
        response     = 0 where dead

    Source: EMVA 1288 release 4.0, section 2.3, for the DSNU. The exponential tail of hot pixels is
    an assumption; proton damage has such tails (Hopkinson, Dale and Marshall 1996, IEEE
    Transactions on Nuclear Science 43, 614).
    """

    dsnu: Annotated[float, Unit("electron / s"), NON_NEGATIVE,
        "electron / second rms over the pixels, at the reference temperature"] = 0.0  # fmt: skip
    hot: Annotated[float, Range(0, 1), "fraction of the pixels"] = 0.0
    hot_current: Annotated[float, Unit("electron / s"), NON_NEGATIVE,
        "electron / second, mean over the hot pixels, at the reference temperature"
    ] = 0.0  # fmt: skip
    dead: Annotated[float, Range(0, 1), "fraction of the pixels"] = 0.0
    dead_columns: Annotated[int, Range(0, 2**16), "number of columns without response"] = 0


def photo_response(
    shape: tuple[int, int], prnu: float, defects: Defects | None, device: Streams
) -> Floats:
    """Response of each pixel over the mean: normal of rms `prnu`, at least 0; 0 for dead pixels."""
    response = np.ones(shape)
    if prnu:
        response += prnu * device("photo response").standard_normal(shape)
        np.maximum(response, 0.0, out=response)
    if defects and defects.dead:
        response[device("dead pixels").random(shape) < defects.dead] = 0.0
    if defects and defects.dead_columns:
        order = device("dead columns").permutation(shape[1])
        response[:, order[: defects.dead_columns]] = 0.0
    return response


def dark_response(
    shape: tuple[int, int], current: float, defects: Defects, device: Streams
) -> Floats:
    """Dark current of each pixel, electron / second at the reference temperature."""
    dark = np.full(shape, current)
    if defects.dsnu:
        dark += defects.dsnu * device("dark current").standard_normal(shape)
        np.maximum(dark, 0.0, out=dark)
    if defects.hot:
        choice, size = device("hot pixels").random((2, *shape))
        dark -= np.where(choice < defects.hot, defects.hot_current * np.log1p(-size), 0.0)
    return dark


LINE_NOISE = "electron rms, random in each frame"


@dataclass(frozen=True)
class Pattern(Parameters):
    """Normal offsets of the signal that the pixels of a row or column share.

    Source: EMVA 1288 release 4.0, section 2.3 (row and column variances).
    """

    row: Annotated[float, Unit("electron"), NON_NEGATIVE, LINE_NOISE] = 0.0
    column: Annotated[float, Unit("electron"), NON_NEGATIVE, LINE_NOISE] = 0.0
    column_offset: Annotated[float, Unit("electron"), NON_NEGATIVE,
        "electron rms over the columns, fixed for each device"] = 0.0  # fmt: skip


def offsets(
    pattern: Pattern, shape: tuple[int, int], device: Streams, streams: Streams
) -> tuple[Floats, Floats]:
    """Offsets of rows (rows, 1) and of columns (columns,), electron."""
    rows, columns = shape
    down, across = np.zeros((rows, 1)), np.zeros(columns)
    if pattern.row:
        down += pattern.row * streams("row noise").standard_normal((rows, 1))
    if pattern.column:
        across += pattern.column * streams("column noise").standard_normal(columns)
    if pattern.column_offset:
        across += pattern.column_offset * device("column offset").standard_normal(columns)
    return down, across
