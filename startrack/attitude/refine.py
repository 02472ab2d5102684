"""Gauss-Newton on the residuals in the image plane, and the covariance of the attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.camera import Camera

Floats = NDArray[np.float64]

MOST_STEPS = 10
SMALLEST_STEP = 1e-15  # radian


@dataclass(frozen=True, eq=False)
class Refinement:
    """An attitude at the minimum of the weighted residuals.

    icrs_to_camera  attitude
    covariance      (3, 3) radian^2, of the small rotation about the camera's axes
    residual        (n, 2) pixel, seen minus predicted
    chi_square      (n,) squared residuals over their covariance
    """

    icrs_to_camera: Rotation
    covariance: Floats
    residual: Floats
    chi_square: Floats


def refine(
    pixel: Floats, covariance: Floats, direction: Floats, camera: Camera, start: Rotation
) -> Refinement:
    """Minimise sum_i r_i^T C_i^-1 r_i over small rotations about the camera's axes.

    The residuals are taken in the undistorted image plane, where x/z of a direction changes with
    a rotation d by (-xy, 1 + x^2, -y) d and y/z by (-(1 + y^2), xy, x) d.

    pixel       (n, 2) seen centroids
    covariance  (n, 2, 2) pixel^2
    direction   (n, 3) unit vectors, ICRS axes
    start       icrs_to_camera near the minimum
    Errors      ValueError where the stars leave the attitude open (fewer than two directions).
                model: the covariance of a centroid is taken as the same before distortion.
                numerical: the residuals are differences of like numbers, so that the result has
                all digits of a double.
    """
    seen = camera.unproject(pixel)
    seen_plane = seen[:, :2] / seen[:, 2:]
    whitener = np.linalg.inv(np.linalg.cholesky(covariance)) * camera.focal_length_px
    attitude = start
    for _ in range(MOST_STEPS):
        residual, design = _linearise(attitude.apply(direction), seen_plane)
        white = np.einsum("nij,njk->nik", whitener, design).reshape(-1, 3)
        target = np.einsum("nij,nj->ni", whitener, residual).reshape(-1)
        step, _, rank, _ = np.linalg.lstsq(white, target, rcond=1e-12)
        if rank < 3:
            raise ValueError("the stars must lie in at least two directions to fix an attitude")
        attitude = Rotation.from_rotvec(step) * attitude
        if np.abs(step).max() < SMALLEST_STEP:
            break
    residual, design = _linearise(attitude.apply(direction), seen_plane)
    target = np.einsum("nij,nj->ni", whitener, residual)
    white = np.einsum("nij,njk->nik", whitener, design).reshape(-1, 3)
    triangle = np.linalg.inv(np.linalg.qr(white, mode="r"))
    return Refinement(
        attitude,
        triangle @ triangle.T,
        residual * camera.focal_length_px,
        np.asarray((target**2).sum(axis=1)),
    )


def _linearise(predicted: Floats, seen_plane: Floats) -> tuple[Floats, Floats]:
    """Residuals (n, 2) in the plane, and their derivatives (n, 2, 3) by the rotation."""
    plane = predicted[:, :2] / predicted[:, 2:]
    return seen_plane - plane, tangent(plane)


def tangent(plane: Floats) -> Floats:
    """How places (n, 2) in the image plane move with a small rotation, (n, 2, 3)."""
    x, y = plane.T
    design = np.empty((len(x), 2, 3))
    design[:, 0] = np.column_stack([-x * y, 1 + x * x, -y])
    design[:, 1] = np.column_stack([-(1 + y * y), x * y, x])
    return design
