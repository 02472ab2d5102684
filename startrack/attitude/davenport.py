"""The rotation that fits weighted directions best, as the eigenvector of Davenport's matrix."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude.products import Array, davenport_matrix, products


def davenport(observed: Array, reference: Array, weight: Array) -> Rotation:
    """Solve Wahba's problem by the q-method.

        K q = lambda q   for the largest eigenvalue

    Source: Davenport (1968), in Wertz (1978), Spacecraft Attitude Determination and Control, 12.2.

    observed   (..., n, 3) unit vectors in the target's axes
    reference  (..., n, 3) unit vectors in the source's axes
    weight     (..., n) inverse variances, on any scale
    Returns    source_to_target
    Errors     numerical: as `svd`, eps over the gap between the two largest eigenvalues.
    """
    _, vectors = np.linalg.eigh(davenport_matrix(products(observed, reference, weight)))
    return Rotation.from_quat(vectors[..., 3])
