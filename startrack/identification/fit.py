"""Attitude and scale from matched directions and points in the image plane."""

import math

import numpy as np

from startrack.core import Floats, Ints, axes_of_pair, kernel, plane_slopes, rotated, turn_by


@kernel
def align(a: Floats, b: Floats, u: Floats, v: Floats) -> Floats:
    """The rotation matrix (3, 3) that takes the mean direction of a and b to that of u and v.

    It takes a to u and b to v, exactly where both pairs have the same separation.

    a, b, u, v  (3,) unit vectors
    """
    source, target, rotation = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    axes_of_pair(a, b, source)
    axes_of_pair(u, v, target)
    for i in range(3):
        for j in range(3):
            rotation[i, j] = (
                target[0, i] * source[0, j]
                + target[1, i] * source[1, j]
                + target[2, i] * source[2, j]
            )
    return rotation


@kernel
def fit(
    plane: Floats,
    weight: Floats,
    direction: Floats,
    spot: Ints,
    star: Ints,
    rotation: Floats,
    scale: float,
    focal: float,
    steps: int,
) -> tuple[Floats, float]:
    """Least squares over the residuals in the image plane, by Gauss-Newton.

        residual = plane - scale (x, y) / z,   (x, y, z) = rotation direction

    plane       (n, 2) x / z and y / z of spots, by the believed camera
    weight      (n,) inverse variance of `plane`
    direction   (m, 3) unit vectors of stars, ICRS axes
    spot, star  (k,) indices of matched spots and stars
    rotation    (3, 3) icrs_to_camera to start from, near the solution
    scale       1, true over believed focal length, to start from
    focal       1, prior standard deviation of the scale about one; 0: the scale is fixed
    steps       number of Gauss-Newton steps
    Returns     rotation (3, 3), scale; NaN if the matches do not determine them
    """
    rotation, unknowns = rotation.copy(), 4 if focal > 0 else 3
    normal, right, step = np.empty((4, 4)), np.empty(4), np.empty(4)
    for _ in range(steps):
        normal[:], right[:] = 0.0, 0.0
        if focal > 0:
            normal[3, 3], right[3] = focal**-2, (1 - scale) * focal**-2
        for i in range(len(spot)):
            px, py, pz = rotated(rotation, direction[star[i]])
            x, y = px / pz, py / pz
            slope_x, slope_y = plane_slopes(x, y)
            row_x = (*slope_x, x / scale)
            row_y = (*slope_y, y / scale)
            dx = plane[spot[i], 0] / scale - x
            dy = plane[spot[i], 1] / scale - y
            w = weight[spot[i]]
            for j in range(4):  # the fourth is not read if the scale is fixed
                right[j] += w * (row_x[j] * dx + row_y[j] * dy)
                for k in range(j + 1):
                    normal[j, k] += w * (row_x[j] * row_x[k] + row_y[j] * row_y[k])
        _solve(normal, right, unknowns, step)
        turn_by(step, rotation)
        scale += step[3]
    return rotation, scale


@kernel
def derivatives(rotation: Floats, direction: Floats, scale: float) -> Floats:
    """Derivatives (2, 4) of a star's position in the image plane by a small rotation and the scale.

    direction  (3,) ICRS axes
    Returns    per radian about the camera's axes, and per unit of the scale
    """
    px, py, pz = rotated(rotation, direction)
    return derivatives_at(px / pz, py / pz, scale)


@kernel
def derivatives_at(x: float, y: float, scale: float) -> Floats:
    """`derivatives` of a star at x / z and y / z of its direction in the camera's axes."""
    rows = np.empty((2, 4))
    slope_x, slope_y = plane_slopes(x, y)
    for k in range(3):
        rows[0, k], rows[1, k] = slope_x[k] * scale, slope_y[k] * scale
    rows[0, 3], rows[1, 3] = x, y
    return rows


@kernel
def cholesky(matrix: Floats, n: int) -> None:
    """Overwrite the lower half of the first n rows of a symmetric matrix by its Cholesky factor."""
    for j in range(n):
        for k in range(j + 1):
            total = matrix[j, k]
            for i in range(k):
                total -= matrix[j, i] * matrix[k, i]
            matrix[j, k] = math.sqrt(total) if j == k else total / matrix[k, k]


@kernel
def _solve(normal: Floats, right: Floats, n: int, solution: Floats) -> None:
    """Write the solution of the first n equations; the rest of (4,) is 0; NaN if there is none."""
    cholesky(normal, n)
    solution[:] = 0.0
    for j in range(n):
        total = right[j]
        for i in range(j):
            total -= normal[j, i] * solution[i]
        solution[j] = total / normal[j, j]
    for j in range(n - 1, -1, -1):
        total = solution[j]
        for i in range(j + 1, n):
            total -= normal[i, j] * solution[i]
        solution[j] = total / normal[j, j]
