"""Least squares in three unknowns without normal equations, which would square the condition."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import kernel


@kernel
def least_squares(columns, triangle, step):  # type: ignore[no-untyped-def]
    """Minimise |A d - t| by modified Gram-Schmidt with the target as the last column.

    That is as stable as Householder's method: Bjorck (1996), Numerical Methods for Least Squares
    Problems, 2.4.

    columns   (4, n) the three columns of A, and t; destroyed
    triangle  (3, 3), written: upper triangular, A = Q triangle; a zero on its diagonal where A
              has no rank
    step      (3,), written: d; not finite where A has no rank
    """
    count = columns.shape[1]
    target = np.zeros(3)
    for i in range(3):
        square = 0.0
        for k in range(count):
            square += columns[i, k] ** 2
        triangle[i, i] = math.sqrt(square)
        scale = 1 / triangle[i, i] if triangle[i, i] > 0 else 0.0
        for k in range(count):
            columns[i, k] *= scale
        for j in range(i + 1, 4):
            along = 0.0
            for k in range(count):
                along += columns[i, k] * columns[j, k]
            for k in range(count):
                columns[j, k] -= along * columns[i, k]
            if j < 3:
                triangle[i, j] = along
            else:
                target[i] = along
    for i in range(2, -1, -1):
        rest = target[i]
        for j in range(i + 1, 3):
            rest -= triangle[i, j] * step[j]
        step[i] = rest / triangle[i, i]


@kernel
def invert(triangle, inverse):  # type: ignore[no-untyped-def]
    """Write the inverse of an upper triangle; infinite where there is none."""
    a, b, c = triangle[0, 0], triangle[1, 1], triangle[2, 2]
    inverse[:] = 0.0
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = 1 / a, 1 / b, 1 / c
    inverse[0, 1] = -triangle[0, 1] / (a * b)
    inverse[1, 2] = -triangle[1, 2] / (b * c)
    inverse[0, 2] = (triangle[0, 1] * triangle[1, 2] / b - triangle[0, 2]) / (a * c)


@kernel
def largest_eigenvalue(m):  # type: ignore[no-untyped-def]
    """Of a symmetric 3 x 3 matrix, to 1e-8 (Smith 1961, Comm. ACM 4, 168)."""
    mean = (m[0, 0] + m[1, 1] + m[2, 2]) / 3
    off = m[0, 1] ** 2 + m[0, 2] ** 2 + m[1, 2] ** 2
    x, y, z = m[0, 0] - mean, m[1, 1] - mean, m[2, 2] - mean
    spread = math.sqrt((x * x + y * y + z * z + 2 * off) / 6)
    if not spread > 0:
        return mean
    x, y, z = x / spread, y / spread, z / spread
    xy, xz, yz = m[0, 1] / spread, m[0, 2] / spread, m[1, 2] / spread
    half = (x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz)) / 2
    return mean + 2 * spread * math.cos(math.acos(min(1.0, max(-1.0, half))) / 3)
