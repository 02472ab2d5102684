"""Multiplication: the gain register of an EMCCD."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import special

Floats = NDArray[np.float64]


def multiply(charge: Floats, gain: float, share: Floats) -> Floats:
    """Electrons at the end of the register: a gamma distribution of shape n and scale `gain`.

        p(x | n) = x^(n - 1) exp(-x / gain) / (gain^n (n - 1)!),   n >= 1

    Its variance doubles that of the shot noise. Source: Basden, Haniff and Mackay (2003), MNRAS
    345, 985.

    charge   (...) electron
    gain     1
    share    (...) uniform numbers in (0, 1)
    Errors   model: a register of many stages with little gain each; no clock-induced charge.
    """
    out = np.zeros_like(charge)
    some = charge > 0
    out[some] = gain * special.gammaincinv(charge[some], share[some])
    return out
