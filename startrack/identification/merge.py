"""Stars enter; those that the camera sees as separate spots leave."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from startrack.values import Floats, Ints, Stars

MAGNITUDE = 0.4 * np.log(10)  # ln of the flux per magnitude


def merged(stars: Stars, resolution: float) -> tuple[Stars, Ints]:
    """Stars closer than the resolution become one, at the centre of their light.

    The brightest of a close group takes up those that lie within the resolution of it.

    resolution  radian
    Returns     the stars that are left, brightest first, under the names and colours of the
                brightest of each, and which of the stars these are
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
    """The star (count,) that each one goes to, itself where it stays; brighter ones come first."""
    taker = np.arange(count)
    pairs = np.sort(pairs, axis=1)
    for brighter, fainter in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]:
        if taker[brighter] == brighter and taker[fainter] == fainter:
            taker[fainter] = brighter
    return taker
