"""Rotation matrices: from pairs of directions, turned, applied, as quaternions; in compiled code.

scipy checks each matrix, which takes longer than the computation of an attitude by a tracker.
"""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core.arrays import Floats, assign
from startrack.core.kernel import kernel


def rotation_of(matrix: Floats) -> Rotation:
    """The rotation of a matrix (3, 3), or of many (m, 3, 3); they are not checked."""
    many = _quaternions(np.ascontiguousarray(matrix, float).reshape(-1, 3, 3))
    return Rotation.from_quat(many.reshape(*matrix.shape[:-2], 4))


def ra_dec(direction: Floats) -> Floats:
    """Right ascension and declination (n, 2), degree, of directions (n, 3) of any length."""
    x, y, z = direction.T
    ra = np.degrees(np.arctan2(y, x)) % 360
    return np.column_stack([ra, np.degrees(np.arctan2(z, np.hypot(x, y)))])


@kernel
def _quaternions(matrix: Floats) -> Floats:
    many = np.empty((len(matrix), 4))
    for n in range(len(matrix)):
        assign(many[n], quaternion(matrix[n]))
    return many


@kernel
def quaternion(rotation: Floats) -> Floats:
    """The quaternion (4,), scalar last, of a rotation matrix, from its largest component."""
    trace = rotation[0, 0] + rotation[1, 1] + rotation[2, 2]
    i = 0
    for k in range(1, 3):
        if rotation[k, k] > rotation[i, i]:
            i = k
    j, k = (i + 1) % 3, (i + 2) % 3
    q = np.empty(4)
    if trace > rotation[i, i]:
        for m in range(3):
            q[m] = rotation[(m + 2) % 3, (m + 1) % 3] - rotation[(m + 1) % 3, (m + 2) % 3]
        q[3] = 1 + trace
    else:
        q[i] = 1 - trace + 2 * rotation[i, i]
        q[j] = rotation[j, i] + rotation[i, j]
        q[k] = rotation[k, i] + rotation[i, k]
        q[3] = rotation[k, j] - rotation[j, k]
    length = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for m in range(4):
        q[m] /= length
    return q


@kernel
def rotated(rotation: Floats, v: Floats) -> tuple[float, float, float]:
    """A vector (3,) after a rotation (3, 3)."""
    return (
        rotation[0, 0] * v[0] + rotation[0, 1] * v[1] + rotation[0, 2] * v[2],
        rotation[1, 0] * v[0] + rotation[1, 1] * v[1] + rotation[1, 2] * v[2],
        rotation[2, 0] * v[0] + rotation[2, 1] * v[1] + rotation[2, 2] * v[2],
    )


@kernel
def turn_by(turn: Floats, rotation: Floats) -> None:
    """Follow a rotation (3, 3), in place, by that of a rotation vector (3,).

    Rodrigues' formula, with half angles for small ones.
    """
    x, y, z = turn[0], turn[1], turn[2]
    angle = math.sqrt(x**2 + y**2 + z**2)
    sine = math.sin(angle) / angle if angle > 0 else 1.0
    versine = 2 * (math.sin(angle / 2) / angle) ** 2 if angle > 0 else 0.5
    for j in range(3):
        u, v, w = rotation[0, j], rotation[1, j], rotation[2, j]
        ux, uy, uz = y * w - z * v, z * u - x * w, x * v - y * u
        rotation[0, j] = u + sine * ux + versine * (y * uz - z * uy)
        rotation[1, j] = v + sine * uy + versine * (z * ux - x * uz)
        rotation[2, j] = w + sine * uz + versine * (x * uy - y * ux)


@kernel
def axes_of_pair(a: Floats, b: Floats, axes: Floats) -> None:
    """Write rows: along the sum of two unit vectors, along their difference, and across both.

    Source: TRIAD, Black (1964), AIAA J. 2(7), 1350, in the form that treats both vectors alike.
    """
    along = across = 0.0
    for k in range(3):
        along += (a[k] + b[k]) ** 2
        across += (b[k] - a[k]) ** 2
    along, across = math.sqrt(along), math.sqrt(across)
    for k in range(3):
        axes[0, k], axes[1, k] = (a[k] + b[k]) / along, (b[k] - a[k]) / across
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        axes[2, k] = axes[0, i] * axes[1, j] - axes[0, j] * axes[1, i]
