"""Stars merged where the camera cannot separate them, and their rank in local brightness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from startrack.core import Floats, Ints, Stars, kernel
from startrack.identification.sky import cubes

MAGNITUDE = 0.4 * np.log(10)  # ln of the flux per magnitude


def merged(stars: Stars, resolution: float) -> tuple[Stars, Ints]:
    """Merge stars closer than the resolution, at the centre of their light.

    The brightest star of a close group is merged with those within the resolution of it.

    resolution  radian
    Returns     the remaining stars, brightest first, with identifier and colour of the brightest
                of each group; the indices of these in `stars`
    """
    order = np.argsort(stars.magnitude_g, kind="stable")
    direction = stars.direction[order]
    pairs = cKDTree(direction).query_pairs(2 * np.sin(resolution / 2), output_type="ndarray")
    taker = _takers(len(stars), pairs)
    flux = np.exp(-MAGNITUDE * stars.magnitude_g[order])
    light = np.zeros(len(stars))
    np.add.at(light, taker, flux)
    centre: Floats = np.zeros_like(direction)
    np.add.at(centre, taker, flux[:, None] * direction)
    kept = np.flatnonzero(taker == np.arange(len(stars)))
    alone = light[kept] == flux[kept]
    centre = centre[kept] / np.linalg.norm(centre[kept], axis=1, keepdims=True)
    centre[alone] = direction[kept][alone]  # to the last digit
    names = order[kept]
    left = Stars(
        stars.identifier[names], centre, -np.log(light[kept]) / MAGNITUDE, stars.colour[names]
    )
    return left, names


def _takers(count: int, pairs: NDArray[np.int64]) -> Ints:
    """The star (count,) that each one is merged into, or itself; stars are brightest first."""
    taker = np.arange(count)
    pairs = np.sort(pairs, axis=1)
    for brighter, fainter in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]:
        if taker[brighter] == brighter and taker[fainter] == fainter:
            taker[fainter] = brighter
    return taker


Ranks = NDArray[np.int16]


def local_rank(direction: Floats, radius: float, most: int) -> Ranks:
    """Number of brighter stars within `radius` of each star.

    The brightest star of a region has rank 0. Selecting the stars below a rank thins dense regions
    and keeps sparse ones, so that each field has about the same number of patterns.

    direction  (n, 3) unit vectors, brightest first
    radius     radian
    most       largest rank; stars of this rank do not count as neighbours
    Returns    (n,) rank, at most `most`
    """
    return _rank(np.ascontiguousarray(direction), radius, most, cubes(radius))


@kernel
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
