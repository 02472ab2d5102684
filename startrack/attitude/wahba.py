"""Solvers of Wahba's problem: Davenport's eigenvector, SVD, QUEST and FOAM."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import rotation_of

Array = NDArray[np.floating]


def products(observed: Array, reference: Array, weight: Array) -> Array:
    """Sum the products of the vectors, with weights that sum to one.

        B = sum_i weight_i observed_i reference_i^T / sum_i weight_i

    observed, reference  (..., n, 3) unit vectors
    weight               (..., n), on any scale
    Returns              (..., 3, 3), in the precision of the vectors
    """
    fraction = weight / weight.sum(axis=-1, keepdims=True)
    return np.asarray(np.swapaxes(observed * fraction[..., None], -1, -2) @ reference)


def parts(b: Array) -> tuple[Array, Array, Array]:
    """Of a matrix B: trace (...), sum B + B^T (..., 3, 3), and antisymmetric part (..., 3)."""
    trace = np.trace(b, axis1=-2, axis2=-1)
    vector = np.stack(
        [b[..., 2, 1] - b[..., 1, 2], b[..., 0, 2] - b[..., 2, 0], b[..., 1, 0] - b[..., 0, 1]],
        axis=-1,
    )
    return trace, b + np.swapaxes(b, -1, -2), vector


def svd(observed: Array, reference: Array, weight: Array) -> Rotation:
    """Solve Wahba's problem.

        B = sum_i weight_i observed_i reference_i^T = U S V^T,   R = U diag(1, 1, det U det V) V^T

    Source: Markley (1988), J. Astronaut. Sci. 36(3), 245.

    observed   (..., n, 3) unit vectors in the target's axes
    reference  (..., n, 3) unit vectors in the source's axes
    weight     (..., n) inverse variances, on any scale
    Returns    source_to_target
    Accuracy   numerical: narrow fields lose digits, with an error of sqrt(eps) in the worst case;
               `align` and `refine` restore them.
    """
    u, _, vt = np.linalg.svd(products(observed, reference, weight))
    sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    u[..., 2] *= sign[..., None]
    return rotation_of(u @ vt)


def davenport(observed: Array, reference: Array, weight: Array) -> Rotation:
    """Solve Wahba's problem by the q-method.

        K q = lambda q   for the largest eigenvalue,   q^T K q = trace(R(q)^T B),   q = (x, y, z, w)

    Source: Davenport (1968), in Wertz (1978), Spacecraft Attitude Determination and Control, 12.2.
    The vector of eq. 12-73 has the opposite sign here, because scipy's quaternions rotate vectors
    instead of axes.

    Arguments and result as for `svd`.
    Accuracy   numerical: as `svd`, eps over the gap between the two largest eigenvalues.
    """
    b = products(observed, reference, weight)
    trace, symmetric, vector = parts(b)
    k = np.empty((*b.shape[:-2], 4, 4), b.dtype)
    k[..., :3, :3] = symmetric - trace[..., None, None] * np.eye(3, dtype=b.dtype)
    k[..., :3, 3] = k[..., 3, :3] = vector
    k[..., 3, 3] = trace
    return Rotation.from_quat(np.linalg.eigh(k)[1][..., 3])


# Signs of the columns of B: for no rotation, and for 180 deg about each axis.
FLIPS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
HALF_TURNS = np.array([[0, 0, 0, 1], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])
STEPS = 8  # two suffice, except for stars that contradict each other


def quest(observed: Array, reference: Array, weight: Array) -> Rotation:
    """Solve Wahba's problem by Newton's method on the characteristic polynomial.

        p(l) = (l^2 - a)(l^2 - b) - c l + c s - d,   q ~ (((l^2 - s^2 + k) I + (l - s) S + S^2) z,
                                                          (l + s)(l^2 - s^2 + k) - det S)

    s is the trace of B, S and z its symmetric and antisymmetric parts, and k the trace of the
    adjugate of S. At a rotation by 180 deg the quaternion vanishes. Therefore the references are
    first rotated by 180 deg about the axis that gives the largest scalar part (sequential
    rotations).

    Source: Shuster and Oh (1981), J. Guidance and Control 4(1), 70, eqs. 63 to 71.

    Arguments and result as for `svd`.
    Accuracy   numerical: worse than `svd`, because the polynomial's coefficients contain the fourth
               powers of the singular values; fields of a few degrees lose half of the digits.
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
    largest = np.ones_like(s)  # start: the weights sum to one, and noise reduces it a little
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
    scalar[(scalar == 0) & ~vector.any(axis=-1, keepdims=True)] = 1  # no information: the identity
    fit = Rotation.from_quat(np.concatenate([vector, scalar], axis=-1))
    return fit * Rotation.from_quat(HALF_TURNS[best[..., 0]])


def _times(matrix: Array, vector: Array) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])


def foam(observed: Array, reference: Array, weight: Array) -> Rotation:
    """Solve Wahba's problem by Newton's method on a polynomial of B's invariants.

        p(l) = (l^2 - |B|^2)^2 - 8 l det B - 4 |adj B|^2 = 0,   k = (l^2 - |B|^2) / 2
        R    = ((k + |B|^2) B + l adj(B)^T - B B^T B) / (k l - det B)

    It has no singular attitude. Source: Markley (1993), J. Astronaut. Sci. 41(2), 261.

    Arguments and result as for `svd`.
    Accuracy   numerical: as `quest`; narrow fields lose half of the digits. If all vectors have one
               direction, the result is the identity.
    """
    b = products(observed, reference, weight)
    x, y, z = (b[..., i, :] for i in range(3))
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=-2)
    det = (x * cofactors[..., 0, :]).sum(axis=-1)
    norm = (b**2).sum(axis=(-2, -1))
    minors = (cofactors**2).sum(axis=(-2, -1))
    largest = np.ones_like(det)  # start: the weights sum to one, and noise reduces it a little
    for _ in range(STEPS):
        value = (largest**2 - norm) ** 2 - 8 * largest * det - 4 * minors
        slope = 4 * largest * (largest**2 - norm) - 8 * det
        largest = largest - np.divide(value, slope, out=np.zeros_like(det), where=slope > 0)
    k, norm, largest = (
        values[..., None, None] for values in ((largest**2 - norm) / 2, norm, largest)
    )
    matrix = (k + norm) * b + largest * cofactors - b @ np.swapaxes(b, -1, -2) @ b
    # The divisor in the source vanishes if digits are lost; the root of the determinant does not.
    scale = np.cbrt(np.linalg.det(matrix))[..., None, None]
    none = np.broadcast_to(np.eye(3, dtype=b.dtype), b.shape).copy()
    matrix = np.divide(matrix, scale, out=none, where=scale > 0)
    return rotation_of(matrix)
