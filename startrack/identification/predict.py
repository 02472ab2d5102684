"""The stars that the image should hold at an attitude, and their positions."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import Floats, Ints, kernel
from startrack.identification.fit import turned
from startrack.identification.seen import Seen
from startrack.identification.sky import SkyGrid, cubes_around, most_within


@kernel
def predict(
    seen: Seen, sky: SkyGrid, rotation: Floats, scale: float
) -> tuple[Ints, Floats]:  # pragma: no cover
    """Indices into `sky` (m,) and positions in the plane (m, 2) of the stars in the image.

    rotation  (3, 3) icrs_to_camera
    scale     true over believed focal length
    """
    rxx, rxy, rxz = rotation[0]
    ryx, ryy, ryz = rotation[1]
    rzx, rzy, rzz = rotation[2]
    reach = min(1.02 * seen.corner / min(scale, 1.0), 1.57)
    nearest = math.cos(reach)
    low, high = cubes_around(sky, rotation[2], reach)
    left, top = seen.low
    right, bottom = seen.high
    star = np.empty(most_within(sky, low, high) + 1, np.int64)
    place = np.empty((len(star), 2))
    count = 0
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            # Cubes along the last axis are contiguous, and so are their stars.
            row = (i * sky.side + j) * sky.side
            for s in range(sky.start[row + low[2]], sky.start[row + high[2] + 1]):
                dx, dy, dz = sky.direction[s, 0], sky.direction[s, 1], sky.direction[s, 2]
                z = rzx * dx + rzy * dy + rzz * dz
                x = scale * (rxx * dx + rxy * dy + rxz * dz) / z
                y = scale * (ryx * dx + ryy * dy + ryz * dz) / z
                star[count] = s
                place[count, 0], place[count, 1] = x, y
                # No branch: half would be mispredicted, which takes three times as long.
                count += (z > nearest) & (left <= x) & (x <= right) & (top <= y) & (y <= bottom)
    return star[:count], place[:count]


@kernel
def project(
    direction: Floats, star: Ints, rotation: Floats, scale: float
) -> Floats:  # pragma: no cover
    """Positions (m, 2) of the chosen stars in the image plane."""
    place = np.empty((len(star), 2))
    for i in range(len(star)):
        x, y, z = turned(rotation, direction[star[i]])
        place[i, 0], place[i, 1] = scale * x / z, scale * y / z
    return place
