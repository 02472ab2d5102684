"""Three scenarios of Markley and Mortari (2000): errors about the body's axes, and loss function.

Source: F. L. Markley and D. Mortari, Quaternion attitude estimation using vector observations, J.
Astronautical Sciences 48, 359.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import arcsec, deg
from startrack.attitude import align
from startrack.benchmark import solving as cases
from startrack.core import Floats


def unequal(side: float) -> Floats:
    """Unit vectors of Markley and Mortari's second and third scenario."""
    return cases.unit(np.array([[1, 0, 0], [side, 0.07584, 0], [side, -0.07584, 0]]))


CROSS = cases.unit(
    np.array([[1, 0, 0], *([0.99712, *yz] for yz in 0.07584 * np.array([*np.eye(2), *-np.eye(2)]))])
)
SCENARIOS = {
    "1": (CROSS, np.full(5, 6 * arcsec), np.full(5, 6 * arcsec)),
    "2": (unequal(-0.99712), np.array([arcsec, deg, deg]), np.array([arcsec, deg, deg])),
    "3": (unequal(-0.99712), np.array([1, 0.1, 0.1]) * deg, np.full(3, 0.1 * deg)),
}


def scenario(name: str, trials: int = 5000) -> dict[str, Any]:
    """Errors (arcsec, about the body's axes, the first is the boresight) and loss."""
    body, noise, stated = SCENARIOS[name]
    rng = np.random.default_rng(int(name))
    truth = Rotation.from_quat(rng.standard_normal((trials, 4)))
    reference = np.einsum("mji,nj->mni", truth.as_matrix(), body)
    reference = cases.unit(reference + noise[:, None] * rng.standard_normal(reference.shape))
    weight = np.broadcast_to(stated**-2, reference.shape[:2])
    got = align(np.broadcast_to(body, reference.shape), reference, weight)
    error = (got.source_to_target * truth.inv()).as_rotvec()
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(got.covariance), error)
    return {
        "rms_arcsec": (np.sqrt((error**2).mean(axis=0)) / arcsec).tolist(),
        "stated_arcsec": (np.sqrt(np.diagonal(got.covariance.mean(axis=0))) / arcsec).tolist(),
        "loss": float(got.loss.mean()),
        "expected_loss": len(body) - 1.5,
        "nees": float(nees.mean()),
    }
