"""Blooming: charge beyond the full well runs along its column."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def bloom(charge: Floats, full_well: float) -> Floats:
    """Charge after each overfull pixel spilt one half of its excess up and one half down.

    What runs on fills each pixel to its full well, until nothing is left or the array ends.
    Source: Janesick (2001), Scientific Charge-Coupled Devices, on blooming.

    charge   (rows, columns) electron
    Returns  (rows, columns) electron, at most full_well; the sum is kept but for what runs out of
             the array
    """
    held = np.minimum(charge, full_well)
    for column in np.flatnonzero((charge > full_well).any(axis=0)):
        excess = (charge[:, column] - held[:, column]) / 2
        _run(held[:, column], excess, full_well)
        _run(held[::-1, column], excess[::-1], full_well)
    return held


@njit(cache=True, error_model="numpy")
def _run(held, excess, full_well):  # type: ignore[no-untyped-def]
    running = 0.0
    for row in range(len(held)):
        running += excess[row]
        taken = min(running, full_well - held[row])
        held[row] += taken
        running -= taken
