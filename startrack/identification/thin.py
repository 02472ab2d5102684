"""Stars enter; how bright each is among its neighbours leaves."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.sky import cubes
from startrack.values import Floats

Ranks = NDArray[np.int16]


def local_rank(direction: Floats, radius: float, most: int) -> Ranks:
    """How many brighter stars lie within `radius` of each star.

    The brightest star of a region has rank 0. To take the stars below a rank thins the dense
    sky and keeps the sparse one, so that each field has its share of patterns.

    direction  (n, 3) unit vectors, brightest first
    radius     radian
    most       counting ends here; stars of this rank do not count as neighbours
    Returns    (n,) rank, at most `most`
    """
    return _rank(np.ascontiguousarray(direction), radius, most, cubes(radius))


@njit(cache=True, error_model="numpy")
def _rank(direction: Floats, radius: float, most: int, side: int) -> Ranks:  # pragma: no cover
    n = len(direction)
    rank = np.empty(n, np.int16)
    newest = np.full(side**3, -1, np.int32)  # the cubes are linked lists: last star put in
    before = np.empty(n, np.int32)  # and the star put in before each
    limit = np.cos(radius)
    reach = int(np.ceil(radius / 2 * side))
    for s in range(n):
        x, y, z = direction[s]
        i0 = min(int((x + 1) / 2 * side), side - 1)
        j0 = min(int((y + 1) / 2 * side), side - 1)
        k0 = min(int((z + 1) / 2 * side), side - 1)
        count = 0
        for i in range(max(i0 - reach, 0), min(i0 + reach + 1, side)):
            for j in range(max(j0 - reach, 0), min(j0 + reach + 1, side)):
                for k in range(max(k0 - reach, 0), min(k0 + reach + 1, side)):
                    t = newest[(i * side + j) * side + k]
                    while t >= 0 and count < most:
                        d = direction[t]
                        if d[0] * x + d[1] * y + d[2] * z >= limit:
                            count += 1
                        t = before[t]
        rank[s] = count
        if count < most:
            home = (i0 * side + j0) * side + k0
            before[s] = newest[home]
            newest[home] = s
    return rank
