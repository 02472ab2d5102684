"""Camera and attitude -> the part of the attitude's error that lasts from frame to frame; its
range."""

from __future__ import annotations

import math

import numpy as np

from startrack import core, response
from startrack.core import Floats
from startrack.design import Case

# Fraction of a pixel, motion of stars over which their pixel errors change; chosen by hand.
PIXEL_LENGTH = 0.5


def error_lengths(case: Case) -> Floats:
    """Radian (2,), turn of a camera over which errors over pixels, and over the field, change.

    They are half a pixel, and half of the field's smaller side.
    """
    camera = case.believed_camera
    half = math.atan(min(camera.columns, camera.rows) / 2 / camera.focal_length_px)
    return np.array([PIXEL_LENGTH / camera.focal_length_px, half])


def lasting_parts(
    case: Case, spots: core.Spots, matches: core.Matches, estimate: core.Estimate
) -> Floats:
    """Lasting parts (3, 3, 3) of a measured attitude's covariance: over pixels in x, in y, and over
    the field.

    For least squares with weights w of stars, and a lasting fraction f of their variance,

        P [sum w f (J_x J_x' + J_y J_y')] P,   P^-1 = sum w (J_x J_x' + J_y J_y')

    J_x and J_y are the derivatives of a star's x and y by turns about the axes; errors in x use
    J_x, and errors in y use J_y. The result is scaled to the covariance that the estimate states.

    Accuracy  model: jitter is independent in each frame; calibration residuals belong to the field.
    """
    assert estimate.icrs_to_camera is not None
    noise = np.trace(spots.covariance[matches.spot], axis1=1, axis2=2) / 2
    knowledge = response.knowledge_of(case)
    systematic, pixel, hot = (
        variance[matches.star]
        for variance in (knowledge.systematic, knowledge.of_pixels, knowledge.hot)
    )
    weight = 1 / (noise + systematic)
    u, v, w = estimate.icrs_to_camera.apply(matches.direction).T
    u, v = u / w, v / w
    in_x = np.stack([-u * v, 1 + u**2, -v], axis=1)
    in_y = np.stack([-1 - v**2, u * v, u], axis=1)

    def summed(weight: Floats, *slopes: Floats) -> Floats:
        return np.asarray(sum((weight[:, None] * slope).T @ slope for slope in slopes))

    # User code states its covariance itself.
    shared = None if core.is_code(case.tracker.attitude.method) else knowledge.shared
    still = estimate.covariance - np.diag(shared.turn) if shared else estimate.covariance
    # Triangles of P^-1 and of the inverse of the stated covariance, to which P is scaled.
    fit = np.linalg.cholesky(summed(weight, in_x, in_y))
    stretch = np.linalg.solve(np.linalg.cholesky(np.linalg.inv(still)).T, np.linalg.inv(fit))
    share = weight / (noise + systematic + hot)
    of_pixel, of_field = share * (pixel + hot), share * np.maximum(systematic - pixel, 0.0)
    sums = summed(of_pixel, in_x), summed(of_pixel, in_y), summed(of_field, in_x, in_y)
    return np.array([stretch @ part @ stretch.T for part in sums])
