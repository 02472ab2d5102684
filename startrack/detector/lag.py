"""Lag: charge that a frame leaves to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def carry(electrons: Floats, before: Floats | None, share: float) -> Floats:
    """Expected electrons that are read with a frame.

        read = (1 - share) electrons + share before

    Each electron stays behind by its own chance, so that the numbers remain Poisson's. Source:
    Janesick (2001), Scientific Charge-Coupled Devices, on deferred charge, cut to one frame.

    electrons  (rows, columns) electron, made in this frame
    before     the same of the frame before, None where the pixels were empty
    """
    kept = (1 - share) * electrons
    return kept if before is None else kept + share * before
