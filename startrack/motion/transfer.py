"""Motion within an exposure -> its PSF, its transfer function and its MTF at Nyquist."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Floats, LineOfSight, Refused, kernel, positive, whole


def density(time: Floats, offset: Floats, columns: int, rows: int, cell: float = 1.0) -> Floats:
    """The time density of a path, as fractions in the cells of a grid around its origin.

    This is the integral of eq. (14) of Krutz et al. (2011) over each cell. As printed, it divides
    by v_x, which is 0 at turning points, at rest and for motion along y; here time is summed.

    time     (m,) second, increasing
    offset   (m, 2) pixel, (x, y) at these times, joined by straight lines
    cell      pixel, side of a cell; the grid's centre is at offset (0, 0)
    Returns   (rows, columns) 1; its sum is the fraction of the time that the path is on the grid
    Raises    ValueError where there are fewer than two increasing times.
    Accuracy  numerical: second order in the distance of the times.
    """
    time, offset = np.asarray(time, float), np.asarray(offset, float)
    whole(1, 2**15, columns=columns, rows=rows)
    positive(cell=cell)
    if len(time) < 2 or not np.isfinite(time).all() or not (np.diff(time) > 0).all():
        raise Refused("time must hold two or more increasing, finite values")
    if offset.shape != (len(time), 2) or not np.isfinite(offset).all():
        raise Refused(
            f"offset must hold finite (x, y) for {len(time)} times, got shape {offset.shape}"
        )
    fraction = np.diff(time) / (time[-1] - time[0])
    image = np.zeros((rows, columns))
    # Cells as unit squares, the first from 0 to 1.
    x, y = (offset / cell + np.array([columns, rows]) / 2).T
    _deposit(image, np.ascontiguousarray(x), np.ascontiguousarray(y), fraction)
    return image


@kernel
def _deposit(image: Floats, x: Floats, y: Floats, fraction: Floats) -> None:
    """Add the time of each straight segment to the cells that it crosses."""
    for n in range(len(fraction)):
        dx, dy = x[n + 1] - x[n], y[n + 1] - y[n]
        # The segment runs from 0 to 1; next crossings of a column edge and of a row edge.
        step_x, step_y = abs(1 / dx), abs(1 / dy)
        next_x = _first(x[n], dx) * step_x if dx != 0 else np.inf
        next_y = _first(y[n], dy) * step_y if dy != 0 else np.inf
        done = 0.0
        while done < 1:
            end = min(next_x, next_y, 1.0)
            middle = (done + end) / 2
            column, row = int(np.floor(x[n] + middle * dx)), int(np.floor(y[n] + middle * dy))
            if 0 <= row < image.shape[0] and 0 <= column < image.shape[1]:
                image[row, column] += fraction[n] * (end - done)
            if next_x <= end:
                next_x += step_x
            if next_y <= end:
                next_y += step_y
            done = end


@kernel
def _first(position, velocity):  # type: ignore[no-untyped-def]
    """Distance to the first edge ahead, in (0, 1]."""
    if velocity > 0:
        return np.floor(position) + 1 - position
    return position - np.ceil(position) + 1


NYQUIST = 0.5  # cycles per pixel


def image_path(path: LineOfSight, camera: Camera, direction: Floats) -> Floats:
    """Positions of the image of a star relative to that at the middle of the exposure.

    direction  (3,) in camera axes, at the middle of the exposure
    Returns    (m, 2) pixel, (x, y) at each time of the path
    Raises     ValueError where the star is behind the camera at any time.
    """
    direction = np.asarray(direction, float)
    seen = Rotation.from_rotvec(path.rotation).apply(direction)
    if direction[2] <= 0 or (seen[:, 2] <= 0).any():
        raise Refused("the star must stay before the camera in the whole exposure, it does not")
    return camera.project(seen) - camera.project(direction)


def transfer(offset: Floats, weight: Floats, frequency: Floats) -> NDArray[np.complex128]:
    """The transfer function of a motion: the Fourier transform of the PSF of its time density.

        M(f) = (1 / T) Int exp(-2 pi i f . s(t)) dt

    The integral over time replaces 1 / |v_x| in eq. (14) of Krutz et al. (2011), so that rest,
    turning points and motion along y need no exception.

    offset     (m, 2) pixel, (x, y)
    weight     (m,) 1, fraction of the exposure
    frequency  (..., 2) cycles / pixel, along x and y
    Returns    (...) 1; its modulus is the modulation transfer function (MTF)
    Accuracy   numerical: that of the points of the path: 1e-6 up to the Nyquist frequency.
    """
    phase = np.asarray(frequency, float) @ np.asarray(offset, float).T
    return np.exp(-2j * np.pi * phase) @ weight


def nyquist_mtf(offset: Floats, weight: Floats) -> tuple[float, float]:
    """The MTF at half a cycle per pixel, along x and along y; arguments as in `transfer`."""
    x, y = np.abs(transfer(offset, weight, np.diag([NYQUIST, NYQUIST]))).tolist()
    return x, y
