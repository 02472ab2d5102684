"""Gauss-Newton on the residuals in the image plane, and the covariance of the attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude.align import turn_by
from startrack.attitude.least_squares import invert, least_squares
from startrack.core import Camera, Floats, Refused, kernel, plane_slopes, rotation_of

MOST_STEPS = 10  # a limit: the start is close to the minimum
SMALLEST_STEP = 1e-15  # radian, some eps
# Of the largest diagonal element, below which the stars have no second direction. Chosen by hand:
# between rounding, 1e-16, and the narrowest fields.
LEAST_RANK = 1e-12


@dataclass(frozen=True, eq=False)
class Refinement:
    """An attitude at the minimum of the weighted residuals.

    icrs_to_camera  attitude
    covariance      (3, 3) radian^2, of the small rotation about the camera's axes
    residual        (n, 2) pixel, measured minus predicted
    chi_square      (n,) squared residuals over their covariance
    scale           1, focal length over that of the camera
    """

    icrs_to_camera: Rotation
    covariance: Floats
    residual: Floats
    chi_square: Floats
    scale: float


def refine(
    pixel: Floats,
    covariance: Floats,
    direction: Floats,
    camera: Camera,
    start: Rotation,
    tolerance: float = 0.0,
) -> Refinement:
    """Minimise sum_i r_i^T C_i^-1 r_i + (s - 1)^2 / tolerance^2 over rotations and the scale s.

    The residuals are taken in the undistorted image plane, where x/z of a direction changes with
    a small rotation d about the camera's axes by s (-xy, 1 + x^2, -y) d and y/z by
    s (-(1 + y^2), xy, x) d, and in proportion to themselves with s. The covariance is that of the
    attitude with the scale estimated too.

    pixel       (n, 2) measured centroids
    covariance  (n, 2, 2) pixel^2
    direction   (n, 3) unit vectors, ICRS axes
    start       icrs_to_camera near the minimum
    tolerance   1, prior standard deviation of the scale; 0 holds it
    Returns     Refinement
    Raises      ValueError where the attitude is not observable (fewer than two directions).
    Accuracy    model: the covariance of a centroid is assumed to be the same without distortion.
                numerical: rounding only, because the residuals are differences of nearly equal
                numbers.
    """
    seen = camera.unproject(pixel)
    seen_plane = seen[:, :2] / seen[:, 2:]
    # (n, 3) the lower triangle of a matrix that makes the noise of a position one.
    root = np.linalg.inv(np.linalg.cholesky(covariance)) * camera.focal_length_px
    whitener = np.ascontiguousarray(root[:, [0, 1, 1], [0, 0, 1]])
    direction = np.ascontiguousarray(direction)  # which those that scipy has turned are not
    matrix = start.as_matrix()
    inverse, chi_square = np.empty((3, 3)), np.empty(len(pixel))
    residual = np.empty_like(seen_plane)
    scale = _refine(
        seen_plane, whitener, direction, tolerance, matrix, inverse, residual, chi_square
    )
    if np.isnan(scale):
        raise Refused("the stars must lie in at least two directions to fix an attitude")
    return Refinement(
        rotation_of(matrix),
        inverse @ inverse.T,
        residual * camera.focal_length_px,
        chi_square,
        scale,
    )


@kernel
def _refine(seen, whitener, direction, tolerance, matrix, inverse, residual, chi_square):  # type: ignore[no-untyped-def]
    """Rotate the matrix to the minimum, write the rest; the scale, NaN if not observable."""
    columns, stretch = np.zeros((4, 2 * len(seen) + 1)), np.zeros(2 * len(seen) + 1)
    triangle, step, along = np.zeros((3, 3)), np.empty(3), np.zeros(4)
    scale = 1.0
    for _ in range(MOST_STEPS):
        _linearise(seen, whitener, direction, matrix, scale, columns, stretch, residual)
        if tolerance > 0:
            _free(stretch, columns, scale, tolerance, along)
        least_squares(columns, triangle, step)
        size = np.abs(np.diag(triangle))
        if not size.min() > LEAST_RANK * size.max():
            return np.nan
        turn_by(step, matrix)
        stretched = along[3] - along[0] * step[0] - along[1] * step[1] - along[2] * step[2]
        scale += stretched
        if np.abs(step).max() < SMALLEST_STEP and abs(stretched) < SMALLEST_STEP:
            break
    _linearise(seen, whitener, direction, matrix, scale, columns, stretch, residual)
    for n in range(len(seen)):
        chi_square[n] = columns[3, 2 * n] ** 2 + columns[3, 2 * n + 1] ** 2
    if tolerance > 0:
        _free(stretch, columns, scale, tolerance, along)
    least_squares(columns, triangle, step)
    invert(triangle, inverse)
    return scale


@kernel
def _linearise(seen, whitener, direction, matrix, scale, columns, stretch, residual):  # type: ignore[no-untyped-def]
    """Residuals (n, 2) in the plane; whitened, their derivatives and themselves, as columns.

    The derivative by the scale is in `stretch`; the last row is reserved for the scale's prior.
    """
    columns[:, -1] = stretch[-1] = 0.0
    for n in range(len(seen)):
        u, v, w = direction[n]
        px = matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2] * w
        py = matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2] * w
        pz = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2] * w
        x, y = px / pz, py / pz
        slope_x, slope_y = plane_slopes(x, y)
        residual[n, 0], residual[n, 1] = seen[n, 0] - scale * x, seen[n, 1] - scale * y
        a, b, c = whitener[n]
        for k in range(3):
            columns[k, 2 * n] = scale * a * slope_x[k]
            columns[k, 2 * n + 1] = scale * (b * slope_x[k] + c * slope_y[k])
        columns[3, 2 * n] = a * residual[n, 0]
        columns[3, 2 * n + 1] = b * residual[n, 0] + c * residual[n, 1]
        stretch[2 * n], stretch[2 * n + 1] = a * x, b * x + c * y


@kernel
def _free(stretch, columns, scale, tolerance, along):  # type: ignore[no-untyped-def]
    """Make the columns orthogonal to the scale's, and write their projections on it (4,)."""
    stretch[-1], columns[3, -1] = 1 / tolerance, (1 - scale) / tolerance
    square = (stretch**2).sum()
    for k in range(4):
        along[k] = (stretch * columns[k]).sum() / square
        columns[k] -= along[k] * stretch


def tangent(plane: Floats) -> Floats:
    """Derivatives (n, 2, 3) of positions (n, 2) in the image plane by a small rotation."""
    design = np.empty((len(plane), 2, 3))
    for row, slopes in enumerate(plane_slopes.py_func(*plane.T)):
        for column, slope in enumerate(slopes):
            design[:, row, column] = slope
    return design
