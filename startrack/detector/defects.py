"""Defects: what the pixels of one copy of a detector do wrong, as maps that never change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from startrack.core import Floats, Streams, Unit, non_negative, whole, within


@dataclass(frozen=True)
class Defects:
    """Pixels that are not like the others.

        dark current = max(mean + dsnu N(0, 1), 0) + (hot: an exponential with mean hot_current)
        response     = 0 where dead

    Source: EMVA 1288 release 4.0, section 2.3, for the DSNU; the exponential
    tail of hot pixels is an assumption, of the shape that proton damage leaves (Hopkinson, Dale
    and Marshall 1996, IEEE Transactions on Nuclear Science 43, 614).

    dsnu          electron / second rms over the pixels, at the reference temperature
    hot           1, fraction of the pixels
    hot_current   electron / second, mean over the hot pixels, at the reference temperature
    dead          1, fraction of the pixels
    dead_columns  how many
    """

    dsnu: Annotated[float, Unit("electron / s")] = 0.0
    hot: float = 0.0
    hot_current: Annotated[float, Unit("electron / s")] = 0.0
    dead: float = 0.0
    dead_columns: int = 0

    def __post_init__(self) -> None:
        non_negative(dsnu=self.dsnu, hot_current=self.hot_current)
        within(0, 1, hot=self.hot, dead=self.dead)
        whole(0, 2**16, dead_columns=self.dead_columns)


def photo_response(
    shape: tuple[int, int], prnu: float, defects: Defects | None, device: Streams
) -> Floats:
    """Response of each pixel over the mean: normal with rms `prnu`, at least zero; dead is zero."""
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
        chance, size = device("hot pixels").random((2, *shape))
        dark -= np.where(chance < defects.hot, defects.hot_current * np.log1p(-size), 0.0)
    return dark
