"""The true motion -> what a gyroscope shows between the frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.sequence.flight import Flight
from startrack.sequence.parameters import Gyro
from startrack.streams import Streams

Floats = NDArray[np.float64]


def shown(flight: Flight, gyro: Gyro, streams: Streams) -> Floats:
    """Mean rates from each frame to the next, as the gyroscope measures them.

    White noise of the rate and a bias that walks at random; the mean of the walk over a step and
    its end are drawn together, so that the step's length does not matter.

    Source: Farrenkopf (1978), J. Guidance and Control 1(4), 282.

    Returns  (m - 1, 3) radian / second, camera axes
    Errors   model: scale factors, misalignments and quantisation are not there; the rate is taken
             as constant between two frames.
    """
    step = np.diff(flight.time)[:, None]
    true = -(flight.attitude[1:] * flight.attitude[:-1].inv()).as_rotvec() / step
    rng = streams("gyroscope")
    begin = gyro.bias * rng.standard_normal(3)
    white, walk, within = rng.standard_normal((3, len(step), 3))
    change = gyro.rate_random_walk * np.sqrt(step) * walk
    bias = begin + np.cumsum(change, axis=0) - change / 2
    bias += gyro.rate_random_walk * np.sqrt(step / 12) * within
    return true + bias + gyro.angle_random_walk / np.sqrt(step) * white
