"""The rotation that fits weighted directions best, as a polynomial of a matrix: FOAM."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude.products import Array, products
from startrack.turns import rotation_of

STEPS = 8  # two do, but for stars that do not belong together


def foam(observed: Array, reference: Array, weight: Array) -> Rotation:
    """Solve Wahba's problem by Newton's method on a polynomial of B's invariants.

        p(l) = (l^2 - |B|^2)^2 - 8 l det B - 4 |adj B|^2 = 0,   k = (l^2 - |B|^2) / 2
        R    = ((k + |B|^2) B + l adj(B)^T - B B^T B) / (k l - det B)

    It has no singular attitude. Source: Markley (1993), J. Astronaut. Sci. 41(2), 261.

    observed   (..., n, 3) unit vectors in the target's axes
    reference  (..., n, 3) unit vectors in the source's axes
    weight     (..., n) inverse variances, on any scale
    Returns    source_to_target
    Errors     numerical: as `quest`; narrow fields lose half of their digits. No turn at all
               where B has no second direction.
    """
    b = products(observed, reference, weight)
    x, y, z = (b[..., i, :] for i in range(3))
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=-2)
    det = (x * cofactors[..., 0, :]).sum(axis=-1)
    norm = (b**2).sum(axis=(-2, -1))
    minors = (cofactors**2).sum(axis=(-2, -1))
    largest = np.ones_like(det)  # the weights sum to one, and noise takes little of that
    for _ in range(STEPS):
        value = (largest**2 - norm) ** 2 - 8 * largest * det - 4 * minors
        slope = 4 * largest * (largest**2 - norm) - 8 * det
        largest = largest - np.divide(value, slope, out=np.zeros_like(det), where=slope > 0)
    k, norm, largest = (each[..., None, None] for each in ((largest**2 - norm) / 2, norm, largest))
    matrix = (k + norm) * b + largest * cofactors - b @ np.swapaxes(b, -1, -2) @ b
    # The divisor of the source vanishes where digits are lost; the determinant's root does not.
    scale = np.cbrt(np.linalg.det(matrix))[..., None, None]
    none = np.broadcast_to(np.eye(3, dtype=b.dtype), b.shape).copy()
    matrix = np.divide(matrix, scale, out=none, where=scale > 0)
    return rotation_of(matrix)
