"""The rotation that fits weighted directions best, by singular value decomposition."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude.products import Array, products
from startrack.turns import rotation_of


def svd(observed: Array, reference: Array, weight: Array) -> Rotation:
    """Solve Wahba's problem.

        B = sum_i weight_i observed_i reference_i^T = U S V^T,   R = U diag(1, 1, det U det V) V^T

    Source: Markley (1988), J. Astronaut. Sci. 36(3), 245.

    observed   (..., n, 3) unit vectors in the target's axes
    reference  (..., n, 3) unit vectors in the source's axes
    weight     (..., n) inverse variances, on any scale
    Returns    source_to_target
    Errors     numerical: it loses digits where fields are narrow (the square root of eps in the
               worst case); `align` and `refine` restore them.
    """
    u, _, vt = np.linalg.svd(products(observed, reference, weight))
    sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    u[..., 2] *= sign[..., None]
    return rotation_of(u @ vt)
