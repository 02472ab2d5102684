"""Spots, Matches -> Estimate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.attitude.refine import refine
from startrack.attitude.svd import svd
from startrack.values import Estimate, Matches, Spots, Status

NO_COVARIANCE = np.full((3, 3), np.nan)


def solve(spots: Spots, matches: Matches) -> Estimate:
    """The attitude from matched stars, weighted by the covariance of their centroids.

    Where the residuals are larger than the centroids' noise explains (chi-square over degrees
    of freedom above one), the covariance is enlarged by that ratio: the tracker does not know
    its distortion or its catalogue better than it sees.
    """
    if matches.status is not Status.SOLVED:
        return _unsolved(matches, matches.status, matches.reason)
    pixel = np.column_stack([spots.x, spots.y])[matches.spot]
    covariance = spots.covariance[matches.spot]
    weight = 2 / np.trace(covariance, axis1=1, axis2=2)
    try:
        start = svd(matches.camera.unproject(pixel), matches.direction, weight)
        best = refine(pixel, covariance, matches.direction, matches.camera, start)
    except (ValueError, np.linalg.LinAlgError) as error:
        return _unsolved(matches, Status.TOO_FEW, str(error))
    freedom = 2 * len(matches) - 3
    excess = max(1.0, best.chi_square / freedom) if freedom > 0 else 1.0
    return Estimate(
        Status.SOLVED,
        matches.reason,
        best.icrs_to_camera,
        best.covariance * excess,
        _rms(best.residual),
        len(matches),
        matches.false_probability,
    )


def _rms(residual: NDArray[np.float64]) -> float:
    """Root mean square over both axes, pixel."""
    return float(np.sqrt(np.mean(residual**2)))


def _unsolved(matches: Matches, status: Status, reason: str) -> Estimate:
    return Estimate(
        status, reason, None, NO_COVARIANCE, float("nan"), len(matches), matches.false_probability
    )
