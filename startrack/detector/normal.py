"""Share -> standard normal number below which this share lies, from a table."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy import special

CELLS = 128  # per factor of two in the share, so that the tail is as exact as the middle
SMALLEST = -56  # power of two
_node = np.arange((1 - SMALLEST) * CELLS + 1)
_power, _place = SMALLEST + _node // CELLS, _node % CELLS
SHARE = np.ldexp((CELLS + _place) / (2 * CELLS), _power)
QUANTILE = special.ndtri(np.minimum(SHARE, 0.75))
# Slope times the width of the cell on the left and on the right of each node.
_slope = math.sqrt(2 * math.pi) * np.exp(QUANTILE**2 / 2)
RISE_AFTER = _slope * np.ldexp(0.5 / CELLS, _power)
RISE_BEFORE = _slope * np.diff(SHARE, prepend=SHARE[0])


@njit(cache=True, error_model="numpy")
def inverse_normal(share):  # type: ignore[no-untyped-def]
    """Phi^-1(share), by cubic Hermite interpolation.

    share   in [2^-54, 1 - 2^-54]
    Errors  numerical: 1e-10.
    """
    nearer = share if share <= 0.5 else 1.0 - share
    fraction, power = math.frexp(nearer)
    at = (fraction - 0.5) * (2 * CELLS)
    i = int(at)
    t = at - i
    i += (power - SMALLEST) * CELLS
    rise = QUANTILE[i + 1] - QUANTILE[i]
    left, right = RISE_AFTER[i] - rise, rise - RISE_BEFORE[i + 1]
    below = QUANTILE[i] + t * (rise + (1 - t) * (left * (1 - t) + right * t))
    return below if share <= 0.5 else -below
