"""What the textbook solvers start from: the sum of weighted products, and Davenport's matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def products(observed: Array, reference: Array, weight: Array) -> Array:
    """Sum the products of the vectors, with weights that sum to one.

        B = sum_i weight_i observed_i reference_i^T / sum_i weight_i

    observed, reference  (..., n, 3) unit vectors
    weight               (..., n), on any scale
    Returns              (..., 3, 3), in the precision of the vectors
    """
    share = weight / weight.sum(axis=-1, keepdims=True)
    return np.asarray(np.swapaxes(observed * share[..., None], -1, -2) @ reference)


def parts(b: Array) -> tuple[Array, Array, Array]:
    """Trace (...), symmetric sum B + B^T (..., 3, 3) and antisymmetric vector (..., 3) of B."""
    trace = np.trace(b, axis1=-2, axis2=-1)
    vector = np.stack(
        [
            b[..., 2, 1] - b[..., 1, 2],
            b[..., 0, 2] - b[..., 2, 0],
            b[..., 1, 0] - b[..., 0, 1],
        ],
        axis=-1,
    )
    return trace, b + np.swapaxes(b, -1, -2), vector


def davenport_matrix(b: Array) -> Array:
    """The symmetric matrix K for which q^T K q = trace(R(q)^T B), q = (x, y, z, w).

    Source: Davenport (1968), in Wertz (1978), Spacecraft Attitude Determination and Control,
    eq. 12-73; the vector has the other sign here, since scipy's quaternions turn vectors.
    """
    trace, symmetric, vector = parts(b)
    k = np.empty((*b.shape[:-2], 4, 4), b.dtype)
    k[..., :3, :3] = symmetric - trace[..., None, None] * np.eye(3, dtype=b.dtype)
    k[..., :3, 3] = k[..., 3, :3] = vector
    k[..., 3, 3] = trace
    return k
