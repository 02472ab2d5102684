"""An attitude enters; the stars that the image should hold, and where, leave."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.fit import turned
from startrack.identification.seen import Seen
from startrack.identification.sky import SkyGrid, cubes_around, rows
from startrack.values import Floats

Places = NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def predict(
    seen: Seen, sky: SkyGrid, rotation: Floats, scale: float
) -> tuple[Places, Floats]:  # pragma: no cover
    """Places in `sky` (m,) and in the plane (m, 2) of the stars that the image should hold.

    rotation  (3, 3) icrs_to_camera
    scale     true over believed focal length
    """
    rxx, rxy, rxz = rotation[0]
    ryx, ryy, ryz = rotation[1]
    rzx, rzy, rzz = rotation[2]
    reach = min(1.02 * seen.corner / min(scale, 1.0), 1.57)
    nearest = math.cos(reach)
    low, high = cubes_around(sky, rotation[2], reach)
    most = 0
    for row in rows(sky, low, high):
        most += sky.start[row + high[2] + 1] - sky.start[row + low[2]]
    star, place = np.empty(most, np.int64), np.empty((most, 2))
    count = 0
    for row in rows(sky, low, high):
        for s in range(sky.start[row + low[2]], sky.start[row + high[2] + 1]):
            dx, dy, dz = sky.direction[s]
            z = rzx * dx + rzy * dy + rzz * dz
            if z < nearest:
                continue
            x = scale * (rxx * dx + rxy * dy + rxz * dz) / z
            y = scale * (ryx * dx + ryy * dy + ryz * dz) / z
            if seen.low[0] <= x <= seen.high[0] and seen.low[1] <= y <= seen.high[1]:
                star[count] = s
                place[count, 0], place[count, 1] = x, y
                count += 1
    return star[:count], place[:count]


@njit(cache=True, error_model="numpy")
def project(
    direction: Floats, star: Places, rotation: Floats, scale: float
) -> Floats:  # pragma: no cover
    """Where (m, 2) the chosen stars fall in the plane."""
    place = np.empty((len(star), 2))
    for i in range(len(star)):
        x, y, z = turned(rotation, direction[star[i]])
        place[i] = scale * x / z, scale * y / z
    return place
