"""The rotation that fits weighted directions best, without decomposing a matrix: QUEST."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude.products import Array, parts, products

# No turn, and half turns about each axis: the columns of B that change their sign.
FLIPS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
HALF_TURNS = np.array([[0, 0, 0, 1], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])
STEPS = 8  # two do, but for stars that do not belong together


def quest(observed: Array, reference: Array, weight: Array) -> Rotation:
    """Solve Wahba's problem by Newton's method on the characteristic polynomial.

        p(l) = (l^2 - a)(l^2 - b) - c l + c s - d,   q ~ (((l^2 - s^2 + k) I + (l - s) S + S^2) z,
                                                          (l + s)(l^2 - s^2 + k) - det S)

    with s the trace, S and z the symmetric and antisymmetric parts of B, k the trace of the
    adjugate of S. At half a turn the quaternion vanishes; so the references are turned by half
    turns first, and the turn that keeps most of the scalar part is taken (sequential rotations).

    Source: Shuster and Oh (1981), J. Guidance and Control 4(1), 70, eqs. 63 to 71.

    observed   (..., n, 3) unit vectors in the target's axes
    reference  (..., n, 3) unit vectors in the source's axes
    weight     (..., n) inverse variances, on any scale
    Returns    source_to_target
    Errors     numerical: worse than `svd`, since the polynomial's coefficients hold the fourth
               powers of the singular values; fields of a few degrees lose half of their digits.
    """
    flips = FLIPS.astype(observed.dtype)
    turned = products(observed, reference, weight)[..., None, :, :] * flips[:, None, :]
    s, symmetric, z = parts(turned)
    square = symmetric @ symmetric
    k = ((2 * s) ** 2 - np.trace(square, axis1=-2, axis2=-1)) / 2
    det = np.linalg.det(symmetric)
    a, b = s**2 - k, s**2 + (z**2).sum(axis=-1)
    c = det + (z * _times(symmetric, z)).sum(axis=-1)
    d = (z * _times(square, z)).sum(axis=-1)
    largest = np.ones_like(s)  # the weights sum to one, and noise takes little of that
    for _ in range(STEPS):
        value = (largest**2 - a) * (largest**2 - b) - c * largest + c * s - d
        slope = 2 * largest * (2 * largest**2 - a - b) - c
        largest = largest - np.divide(value, slope, out=np.zeros_like(s), where=slope > 0)
    alpha = largest**2 - s**2 + k
    vector = alpha[..., None] * z + (largest - s)[..., None] * _times(symmetric, z)
    vector += _times(square, z)
    scalar = (largest + s) * alpha - det
    best = np.argmax(np.abs(scalar), axis=-1)[..., None]
    vector = np.take_along_axis(vector, best[..., None], axis=-2)[..., 0, :]
    scalar = np.take_along_axis(scalar, best, axis=-1)
    scalar[(scalar == 0) & ~vector.any(axis=-1, keepdims=True)] = 1  # nothing is known
    fit = Rotation.from_quat(np.concatenate([vector, scalar], axis=-1))
    return fit * Rotation.from_quat(HALF_TURNS[best[..., 0]])


def _times(matrix: Array, vector: Array) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])
