"""Drawn stars of many trials -> their attitudes, with covariances as the tracker states them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import special

from startrack.attitude import Alignment, align
from startrack.attitude.scale import scale_unknown
from startrack.case import Case
from startrack.values import Floats

SURPRISE = 1e-3  # chance below which residuals are too large to be the noise alone


def fitted(
    case: Case,
    matrix: Floats,
    seen: Floats,
    reference: Floats,
    noise: Floats,
    there: NDArray[np.bool_],
) -> tuple[Alignment, Floats]:
    """Attitudes of m trials with up to n stars each, and their covariances as the tracker has them.

    matrix     (m, 3, 3) true icrs_to_camera, by which the identification knows its stars
    seen       (m, n, 2) pixel;  reference  (m, n, 3) directions;  noise  (m, n) pixel^2
    there      (m, n) which of them are there
    """
    camera, tolerance = case.believed_camera, case.tracker.identification.focal_tolerance
    if tolerance:
        towards = _turned(matrix, reference)
        predicted = camera.project(towards.reshape(-1, 3)).reshape(seen.shape)
        scale = 1 + np.clip(
            _scales(seen, predicted, noise, there, tolerance), -tolerance, tolerance
        )
        seen = camera.centre + (seen - camera.centre) / scale[:, None, None]
    observed = camera.unproject(seen.reshape(-1, 2)).reshape(reference.shape)
    weight = np.where(there, camera.focal_length_px**2 / noise, 0.0)
    found = align(observed, reference, weight)
    # As the tracker's solver does with residuals that the noise does not explain.
    freedom = np.maximum(2 * there.sum(axis=1) - (4 if tolerance else 3), 1)
    chance = special.chdtrc(freedom, 2 * found.loss)
    excess = np.where(chance < SURPRISE, 2 * found.loss / freedom, 1.0)
    covariance = found.covariance
    if tolerance:
        covariance = scale_unknown(covariance, observed, weight, tolerance)
    return found, covariance * excess[:, None, None]


@njit(cache=True, error_model="numpy")
def _turned(matrix, direction):  # type: ignore[no-untyped-def]
    """Directions (m, n, 3) in the axes of m cameras, the same digits for any n."""
    turned = np.empty_like(direction)
    for n in range(len(direction)):
        for k in range(direction.shape[1]):
            for i in range(3):
                turned[n, k, i] = (
                    matrix[n, i, 0] * direction[n, k, 0]
                    + matrix[n, i, 1] * direction[n, k, 1]
                    + matrix[n, i, 2] * direction[n, k, 2]
                )
    return turned


@njit(cache=True, error_model="numpy")
def _scales(seen, predicted, noise, there, tolerance):  # type: ignore[no-untyped-def]
    """By how much the identification takes the focal length for longer, (m,) 1.

    It fits the scale together with the attitude, to stars weighted by their noise and with the
    tolerance as its standard deviation beforehand.
    """
    scale = np.zeros(len(seen))
    for n in range(len(seen)):
        x = y = total = 0.0
        for k in range(seen.shape[1]):
            if there[n, k]:
                w = 1 / noise[n, k]
                x, y, total = x + w * predicted[n, k, 0], y + w * predicted[n, k, 1], total + w
        x, y = x / max(total, 1e-300), y / max(total, 1e-300)
        along, size = 0.0, tolerance**-2
        for k in range(seen.shape[1]):
            if there[n, k]:
                w = 1 / noise[n, k]
                arm_x, arm_y = predicted[n, k, 0] - x, predicted[n, k, 1] - y
                along += w * arm_x * (seen[n, k, 0] - predicted[n, k, 0])
                along += w * arm_y * (seen[n, k, 1] - predicted[n, k, 1])
                size += w * (arm_x * arm_x + arm_y * arm_y)
        scale[n] = along / size
    return scale
