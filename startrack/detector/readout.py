"""Electrons -> digital numbers: shot noise, full well, read noise, converter, in one pass."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detector.parameters import Detector
from startrack.detector.poisson import quantile
from startrack.streams import Streams


def read_out(
    electrons: NDArray[np.float64], detector: Detector, streams: Streams
) -> NDArray[np.uint16]:
    """The digital image of expected electrons.

        charge = min(Poisson(electrons), full_well) + read noise
        DN = clip(round(charge / electrons_per_dn + offset), 0, 2^bits - 1)

    Source: Krutz et al. (2011), eq. (5); EMVA 1288 release 4.0, section 2.2.

    electrons  (rows, columns) expectation of photo- and dark electrons
    Errors     numerical: the law is exact, see `poisson_quantile`.
    """
    shot = streams("shot noise").standard_normal(electrons.shape)
    # What a design does not have is not drawn.
    read = (
        streams("read noise").standard_normal(electrons.shape)
        if detector.read_noise
        else np.zeros((1, 1))
    )
    return _read_out(
        electrons,
        shot,
        read,
        detector.read_noise,
        detector.full_well,
        1 / detector.electrons_per_dn,
        float(detector.offset),
        2**detector.bits - 1,
    )


@njit(cache=True, error_model="numpy")
def _read_out(electrons, shot, read, read_noise, full_well, gain, offset, largest):  # type: ignore[no-untyped-def]
    rows, columns = electrons.shape
    image = np.empty((rows, columns), np.uint16)
    for row in range(rows):
        for column in range(columns):
            charge = min(quantile(electrons[row, column], shot[row, column]), full_well)
            if read_noise > 0.0:
                charge += read_noise * read[row, column]
            number = math.floor(charge * gain + offset + 0.5)
            image[row, column] = min(max(number, 0), largest)
    return image
