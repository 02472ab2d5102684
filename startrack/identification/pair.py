"""Spots and predicted stars enter; one-to-one matches leave."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.values import Floats

Places = NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def pair(
    plane: Floats, place: Floats, radius: Floats
) -> tuple[Places, Places, Floats]:  # pragma: no cover
    """Each star takes its nearest spot, each spot its nearest taker.

    plane    (n, 2) spots
    place    (m, 2) predicted stars
    radius   (n,) how far each spot may lie from its star
    Returns  (k,) spots in rising order, (k,) stars, (k,) distances
    """
    taker = np.full(len(plane), -1)
    nearest = radius**2
    order = np.argsort(plane[:, 0])
    x = plane[order, 0]
    widest = np.max(radius) if len(radius) else 0.0
    for j in range(len(place)):
        best, least = -1, np.inf
        for k in range(np.searchsorted(x, place[j, 0] - widest), len(x)):
            if x[k] > place[j, 0] + widest:
                break
            i = order[k]
            square = (plane[i, 0] - place[j, 0]) ** 2 + (plane[i, 1] - place[j, 1]) ** 2
            if square <= radius[i] ** 2 and square < least:
                best, least = i, square
        if best >= 0 and least <= nearest[best]:
            taker[best], nearest[best] = j, least
    spot = np.flatnonzero(taker >= 0)
    return spot, taker[spot], np.sqrt(nearest[spot])
