"""Rotation matrices -> quaternions and scipy's Rotations, in compiled code.

scipy checks each matrix, and so takes longer to take one than a tracker takes to find it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core.arrays import Floats
from startrack.core.kernel import kernel


def rotation_of(matrix: Floats) -> Rotation:
    """The rotation of a matrix (3, 3), or those of many (m, 3, 3), which are trusted to be such."""
    many = _quaternions(np.ascontiguousarray(matrix, float).reshape(-1, 3, 3))
    return Rotation.from_quat(many.reshape(*matrix.shape[:-2], 4))


@kernel
def _quaternions(matrix: Floats) -> Floats:  # pragma: no cover
    many = np.empty((len(matrix), 4))
    for n in range(len(matrix)):
        many[n] = quaternion(matrix[n])
    return many


@kernel
def quaternion(rotation: Floats) -> Floats:  # pragma: no cover
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
