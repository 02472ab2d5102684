"""The rotation that fits weighted directions best, by singular value decomposition."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]


def svd(observed: Floats, reference: Floats, weight: Floats) -> Rotation:
    """Solve Wahba's problem.

        B = sum_i weight_i observed_i reference_i^T = U S V^T,   R = U diag(1, 1, det U det V) V^T

    Source: Markley (1988), J. Astronaut. Sci. 36(3), 245.

    observed   (n, 3) unit vectors in the target's axes
    reference  (n, 3) unit vectors in the source's axes
    weight     (n,) inverse variances
    Returns    source_to_target
    Errors     numerical: it loses digits where fields are narrow (the square root of eps in the
               worst case); `refine` restores them.
    """
    u, _, vt = np.linalg.svd((observed * weight[:, None]).T @ reference)
    sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    return Rotation.from_matrix(u @ np.diag([1.0, 1.0, sign]) @ vt)
