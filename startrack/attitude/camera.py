"""Identified frames of one camera -> the camera model that fits all of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import (
    NON_NEGATIVE,
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    printed,
)

UNKNOWNS = ("focal_length_px", "principal_x", "principal_y", "k1", "k2", "p1", "p2", "k3")
# Sigma, beyond which a residual counts linearly. Chosen by hand: a smaller one discards information
# of normal residuals, a larger one gives false matches more weight.
HUBER = 2.0
NO_MOTION = np.zeros(3)


class Calibration(Parameters):
    """Prior standard deviation of each unknown about the starting camera; 0 fixes it.

    The priors are Gaussian. An unknown that the frames do not constrain keeps its value and the
    variance of its prior. One narrow frame hardly separates principal point, attitude and
    distortion.
    """

    focal_length: float = parameter("relative", limit=NON_NEGATIVE, default=0.1)
    principal: float = parameter("pixel, along each axis", limit=NON_NEGATIVE, default=20.0)
    k1: float = parameter("radial distortion", limit=NON_NEGATIVE, default=1.0)
    k2: float = parameter("radial distortion", limit=NON_NEGATIVE, default=0.0)
    k3: float = parameter("radial distortion", limit=NON_NEGATIVE, default=0.0)
    tangential: float = parameter("p1 and p2", limit=NON_NEGATIVE, default=0.0)
    floor: float = parameter(
        "pixel, systematic error of a centroid", limit=NON_NEGATIVE, default=0.05
    )
    steps: int = parameter("of Gauss-Newton", limit=Range(1, 1000), default=15)

    def sigma(self, camera: core.Camera) -> Floats:
        """(8,) standard deviations of the priors, in the order of UNKNOWNS."""
        return np.array(
            [
                self.focal_length * camera.focal_length_px,
                self.principal,
                self.principal,
                self.k1,
                self.k2,
                self.tangential,
                self.tangential,
                self.k3,
            ]
        )


@printed
@dataclass(frozen=True, eq=False)
class Calibrated:
    """The estimate of a camera.

    camera        camera from least squares
    covariance    (8, 8) of UNKNOWNS, in their units; zero for a fixed unknown
    residual_rms  pixel, root mean square over both axes of all matches
    stars         number of used matches
    frames        number of used frames
    """

    camera: core.Camera
    covariance: Floats
    residual_rms: Annotated[float, Unit("pixel")]
    stars: int
    frames: int


def calibrate(
    spots: Sequence[core.Spots],
    matches: Sequence[core.Matches],
    camera: core.Camera,
    settings: Calibration,
) -> Calibrated:
    """Robust least squares over the camera and the attitudes of all frames.

    The method is Gauss-Newton with OpenCV's derivatives. The attitudes are eliminated frame by
    frame (Schur complement), so that the time is proportional to the number of frames. Residuals
    beyond HUBER sigma get less weight. A chi-square above the degrees of freedom enlarges the
    covariance in proportion.

    spots    spots of each frame
    matches  matches of each frame; unsolved frames are left out
    camera   camera to start from
    Raises    ValueError if no frame is solved, or lengths differ.
    Accuracy  model: OpenCV's distortion.
    """
    if len(spots) != len(matches):
        raise Refused(
            f"matches must be as many as spots, got {len(matches)} for {len(spots)} frames"
        )
    frames = [
        MatchedFrame(found_spots, match)
        for found_spots, match in zip(spots, matches, strict=True)
        if len(match) >= 3
    ]
    if not frames:
        raise Refused(f"matches must hold a solved frame, got none in {len(matches)}")
    start = camera_vector(camera)
    sigma = settings.sigma(camera)
    free = np.flatnonzero(sigma > 0)
    for _ in range(settings.steps):
        blocks = [frame.normal(camera, free, settings.floor) for frame in frames]
        right = (start - camera_vector(camera))[free] / sigma[free] ** 2
        normal = sum((block.schur for block in blocks), np.diag(sigma[free] ** -2.0))
        right = sum((block.right for block in blocks), right)
        step: Floats = np.linalg.solve(normal, right).astype(np.float64)
        camera = moved_camera(camera, free, step)
        for frame, block in zip(frames, blocks, strict=True):
            frame.turn(block.attitude(step))
    residual = np.concatenate([frame.residual(camera).ravel() for frame in frames])
    chi_square = sum(frame.chi_square(camera, settings.floor) for frame in frames)
    freedom = residual.size - 3 * len(frames) - len(free)
    excess = max(1.0, chi_square / freedom) if freedom > 0 else 1.0
    covariance = np.zeros((len(UNKNOWNS), len(UNKNOWNS)))
    covariance[np.ix_(free, free)] = np.linalg.inv(normal) * excess
    rms = float(np.sqrt(np.mean(residual**2)))
    return Calibrated(camera, covariance, rms, residual.size // 2, len(frames))


@dataclass(frozen=True, eq=False)
class _Block:
    """The normal equations of one frame without its attitude."""

    schur: Floats
    right: Floats
    inverse: Floats
    cross: Floats
    attitude_right: Floats

    def attitude(self, step: Floats) -> Floats:
        """The rotation vector (3,) for a step of the camera."""
        return self.inverse @ (self.attitude_right - self.cross.T @ step)

    def turned_by(self, covariance: Floats) -> Floats:
        """Covariance (3, 3) radian^2 of the frame's attitude by the camera's covariance (k, k)."""
        slope = self.inverse @ self.cross.T
        return slope @ covariance @ slope.T


class MatchedFrame:
    """The matches of one frame, and its current attitude."""

    def __init__(self, spots: core.Spots, matches: core.Matches) -> None:
        assert matches.icrs_to_camera is not None
        self.pixel, self.covariance = matched_pixels(spots, matches)
        self.direction = matches.direction
        self.icrs_to_camera: Rotation = matches.icrs_to_camera

    def turn(self, vector: Floats) -> None:
        """Rotate the attitude by a rotation vector (3,), radian, in camera axes."""
        self.icrs_to_camera = Rotation.from_rotvec(vector) * self.icrs_to_camera

    def residual(self, camera: core.Camera) -> Floats:
        """Pixel (n, 2), spots minus stars."""
        return self.pixel - camera.project(self.icrs_to_camera.apply(self.direction))

    def chi_square(self, camera: core.Camera, floor: float) -> float:
        """Chi-square of the residuals with Huber's weights."""
        _, square, weight = self._weigh(camera, floor)
        return float(np.sum(square * weight))

    def normal(
        self, camera: core.Camera, free: Ints, floor: float, more: Floats | None = None
    ) -> _Block:
        """The normal equations of some of UNKNOWNS, given by their indices.

        more  (n, 2, k) derivatives of the stars' places by further unknowns; None: there are none
        """
        residual = self.residual(camera)
        inverse, _, weight = self._weigh(camera, floor)
        inverse = inverse * weight[:, None, None]
        points = self.icrs_to_camera.apply(self.direction)
        camera_rows, attitude_rows = camera_slopes(camera, points)
        camera_rows = camera_rows[:, :, free]
        if more is not None:
            camera_rows = np.concatenate([camera_rows, more], axis=2)
        weighed = np.einsum("nij,njk->nik", inverse, attitude_rows)
        attitude = np.linalg.inv(np.einsum("nij,nik->jk", attitude_rows, weighed))
        cross = np.einsum("nij,nik->jk", camera_rows, weighed)
        attitude_right = np.einsum("nik,ni->k", weighed, residual)
        weighed = np.einsum("nij,njk->nik", inverse, camera_rows)
        camera_block = np.einsum("nij,nik->jk", camera_rows, weighed)
        right = np.einsum("nik,ni->k", weighed, residual)
        return _Block(
            camera_block - cross @ attitude @ cross.T,
            right - cross @ attitude @ attitude_right,
            attitude,
            cross,
            attitude_right,
        )

    def _weigh(self, camera: core.Camera, floor: float) -> tuple[Floats, Floats, Floats]:
        """Inverse covariances (n, 2, 2), squared residuals over them (n,), Huber's weights (n,).

        HUBER is in units of the typical residual, which exceeds the noise before convergence.
        """
        residual = self.residual(camera)
        inverse: Floats = np.linalg.inv(self.covariance + floor**2 * np.eye(2)).astype(np.float64)
        square = np.einsum("ni,nij,nj->n", residual, inverse, residual)
        return inverse, square, huber_weights(square, max(1.0, typical_square(square)))


def matched_pixels(spots: core.Spots, matches: core.Matches) -> tuple[Floats, Floats]:
    """Places (n, 2), pixel, of the matched spots, and their covariances (n, 2, 2)."""
    pixel = np.column_stack([spots.x, spots.y])[matches.spot]
    return pixel, spots.covariance[matches.spot]


def typical_square(square: Floats) -> float:
    """Robust variance per axis, from sums (n,) of two normal squares: median / (2 ln 2)."""
    return float(np.median(square)) / (2 * np.log(2))


def huber_weights(square: Floats, variance: float) -> Floats:
    """Huber's weights (n,): residuals beyond HUBER typical sizes count linearly.

    square    (n,) squared residuals, both axes together
    variance  variance per axis of a typical residual
    """
    return np.minimum(1.0, HUBER * np.sqrt(2 * variance / np.maximum(square, 1e-300)))


def camera_slopes(camera: core.Camera, points: Floats) -> tuple[Floats, Floats]:
    """Derivatives of the places of directions (n, 3) by a camera and by a small rotation of it.

    Returns  (n, 2, 8) by UNKNOWNS, (n, 2, 3) pixel / radian
    """
    x, y = camera.centre
    matrix = np.array([[camera.focal_length_px, 0, x], [0, camera.focal_length_px, y], [0, 0, 1]])
    coefficients = np.array([camera.k1, camera.k2, camera.p1, camera.p2, camera.k3])
    _, derivatives = cv2.projectPoints(points, NO_MOTION, NO_MOTION, matrix, coefficients)
    jacobian: Floats = np.asarray(derivatives, np.float64).reshape(len(points), 2, -1)
    # OpenCV's columns: rotation 3, translation 3, focal lengths 2, centre 2, distortion 5.
    scale = jacobian[:, :, 6:8].sum(axis=2, keepdims=True)
    return np.concatenate([scale, jacobian[:, :, 8:15]], axis=2), jacobian[:, :, :3]


def camera_vector(camera: core.Camera) -> Floats:
    """(8,) of UNKNOWNS."""
    return np.array([getattr(camera, name) for name in UNKNOWNS], float)


def moved_camera(camera: core.Camera, free: Ints, step: Floats) -> core.Camera:
    """The camera after a step of some of UNKNOWNS, given by their indices."""
    vector = camera_vector(camera)
    vector[free] += step
    return replace(camera, **dict(zip(UNKNOWNS, vector.tolist(), strict=True)))
