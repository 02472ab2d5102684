"""Settling: the impulse response of the read-out channel."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def settle(level: Floats, rest: float) -> Floats:
    """What a channel of limited bandwidth makes of the pixels that pass through it in turn.

        out_i = (1 - rest) in_i + rest out_(i-1)

    A low-pass of first order with time constant tau, sampled at the end of each pixel's time T;
    each row starts settled on its first pixel. Source: Oppenheim and Schafer, Discrete-Time Signal
    Processing, on impulse invariance.

    level  (rows, columns) electron, in the order of reading
    rest   1, exp(-T / tau)
    """
    out, _ = scipy.signal.lfilter([1 - rest], [1, -rest], level, axis=1, zi=rest * level[:, :1])
    return out
