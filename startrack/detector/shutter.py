"""Positions of stars during the exposure, with a global or a rolling shutter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Floats, LineOfSight

Turn = Callable[[Floats], Floats]  # seconds (m,) -> rotation vectors (m, 3) as in LineOfSight
MotionFunction = Callable[
    [Floats, Floats], Floats
]  # starts (p,), steps (j,) -> those of all sums (p, j, 3)
Places = tuple[Floats, Floats, Floats]

BATCH = 2**18  # positions that are projected at a time; chosen by hand: memory against calls
MIDDLE = np.zeros(1)
ITERATIONS = (
    4  # to find the time of a star's row; each leaves row_delay * rows per second of the error
)


def at_once(
    direction: Floats, path: LineOfSight, icrs_to_camera: Rotation, camera: Camera
) -> Iterator[Places]:
    """Points of the path, some at a time: their weights (m,) and the stars' pixels x, y (m, n)."""
    attitude = _turns(path) @ icrs_to_camera.as_matrix()
    together = max(BATCH // max(len(direction), 1), 1)
    for start in range(0, len(attitude), together):
        some = slice(start, start + together)
        towards = direction @ attitude[some].transpose(0, 2, 1)
        pixel = np.ascontiguousarray(camera.project(towards.reshape(-1, 3)).T)
        x, y = pixel.reshape(2, *towards.shape[:2])
        yield path.weight[some], x, y


@lru_cache(maxsize=4)
def _turns(path: LineOfSight) -> Floats:
    """(m, 3, 3) how the sky turns before the camera."""
    return Rotation.from_rotvec(path.rotation).as_matrix()


def row_by_row(
    direction: Floats,
    path: LineOfSight,
    icrs_to_camera: Rotation,
    camera: Camera,
    row_delay: float,
    motion_function: MotionFunction,
) -> Iterator[Places]:
    """The same where each row is exposed `row_delay` second after the one above it.

    A star takes part when its own row does. The attitude is that at the middle of the exposure of
    the middle row.

    motion_function  motion of the camera, beyond the exposure too
    Accuracy  model: all rows of one star's image share the time of its middle, so that a star of a
              few pixels is not sheared.
    """
    here = icrs_to_camera.apply(direction)

    def position(start: Floats, step: Floats) -> Floats:
        turned = Rotation.from_rotvec(motion_function(start, step).reshape(-1, 3))
        towards = turned.apply(np.repeat(here, len(step), axis=0))
        return camera.project(towards).reshape(len(start), len(step), 2)

    def delay(row: Floats) -> Floats:
        inside = np.clip(np.nan_to_num(row), 0, camera.rows - 1)
        return row_delay * (inside - (camera.rows - 1) / 2)

    delays = np.zeros(len(direction))
    for _ in range(ITERATIONS):
        delays = delay(position(delays, MIDDLE)[:, 0, 1])
    together = max(BATCH // max(len(direction), 1), 1)
    for start in range(0, len(path.time), together):
        some = slice(start, start + together)
        yield path.weight[some], *np.ascontiguousarray(position(delays, path.time[some]).T)
