"""Where stars are while the rows of a frame are exposed, by a global or a rolling shutter."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.values import Path

Floats = NDArray[np.float64]
Turn = Callable[[Floats], Floats]

PASSES = 4  # to find the time of a star's row; each leaves row_delay * rows per second of the error


def at_once(
    direction: Floats, path: Path, icrs_to_camera: Rotation, camera: Camera
) -> Iterator[tuple[float, Floats, Floats]]:
    """For each point of the path, its weight and the stars' pixels x, y (n,)."""
    attitude = Rotation.from_rotvec(path.rotation) * icrs_to_camera
    for weight, matrix in zip(path.weight, attitude.as_matrix(), strict=True):
        x, y = camera.project(direction @ matrix.T).T.copy()
        yield float(weight), x, y


def row_by_row(
    direction: Floats,
    path: Path,
    icrs_to_camera: Rotation,
    camera: Camera,
    row_delay: float,
    turn: Turn,
) -> Iterator[tuple[float, Floats, Floats]]:
    """The same where each row is exposed `row_delay` second after the one above it.

    A star takes part when its own row does. The attitude is that at the middle of the exposure of
    the middle row.

    turn    seconds (m,) -> rotation vectors (m, 3) as in Path, beyond the exposure too
    Errors  model: all rows of one star's image share the time of its middle, so that a star of a
            few pixels is not sheared.
    """
    here = icrs_to_camera.apply(direction)

    def place(time: Floats) -> Floats:
        return camera.project(Rotation.from_rotvec(turn(time)).apply(here))

    def delay(row: Floats) -> Floats:
        inside = np.clip(np.nan_to_num(row), 0, camera.rows - 1)
        return row_delay * (inside - (camera.rows - 1) / 2)

    late = np.zeros(len(direction))
    for _ in range(PASSES):
        late = delay(place(late)[:, 1])
    for weight, time in zip(path.weight, path.time, strict=True):
        x, y = place(late + time).T.copy()
        yield float(weight), x, y
