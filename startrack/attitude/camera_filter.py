"""Matches of one frame after the other -> the camera as it is known, with temperature terms."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from startrack.attitude.camera import UNKNOWNS, Calibration, MatchedFrame, moved_camera
from startrack.core import NON_NEGATIVE, Camera, Floats, Ints, Matches, Parameters, Spots, Unit

FEWEST = 4  # stars of a frame that says something of its camera
STEPS = 2  # of Gauss-Newton, in a frame
COUNT = len(UNKNOWNS)


@dataclass(frozen=True)
class CameraFilter(Parameters):
    """A calibration in flight, frame by frame: what is known before, and how the camera changes.

    Random walks are of the square root of the time; slopes are by the temperature.
    """

    prior: Annotated[Calibration, "standard deviations at the begin"] = field(
        default_factory=Calibration
    )
    focal_length_walk: Annotated[float, Unit("1/s(1/2)"), NON_NEGATIVE, "relative"] = 0.0
    principal_walk: Annotated[float, NON_NEGATIVE, "pixel / second^(1/2), along each axis"] = 0.0
    focal_length_slope: Annotated[float, Unit("1/K"), NON_NEGATIVE,
        "relative, standard deviation at the begin"] = 0.0  # fmt: skip
    principal_slope: Annotated[float, NON_NEGATIVE,
        "pixel / kelvin along each axis, standard deviation at the begin"] = 0.0  # fmt: skip

    def sigma(self, camera: Camera) -> Floats:
        """(16,) of UNKNOWNS and of their slopes, at the begin."""
        slopes = np.zeros(COUNT)
        slopes[0] = self.focal_length_slope * camera.focal_length_px
        slopes[1:3] = self.principal_slope
        return np.concatenate([self.prior.sigma(camera), slopes])

    def walk(self, camera: Camera) -> Floats:
        """(16,) change in a second, standard deviation."""
        walk = np.zeros(2 * COUNT)
        walk[0] = self.focal_length_walk * camera.focal_length_px
        walk[1:3] = self.principal_walk
        return walk


@dataclass(frozen=True, eq=False)
class KnownCamera:
    """A camera as it is known after some frames.

    camera      at the reference temperature
    slope       (8,) of UNKNOWNS, 1 / kelvin
    covariance  (16, 16) of UNKNOWNS and their slopes; zero where one is fixed
    """

    camera: Camera
    slope: Floats
    covariance: Floats

    def at(self, warmer: float) -> Camera:
        """The camera at a temperature, kelvin above the reference."""
        return moved_camera(self.camera, np.arange(COUNT), warmer * self.slope)


def first_camera(camera: Camera, settings: CameraFilter) -> KnownCamera:
    """A camera as it is known before the first frame."""
    return KnownCamera(camera, np.zeros(COUNT), np.diag(settings.sigma(camera) ** 2))


def after_frame(
    known: KnownCamera, settings: CameraFilter, spots: Spots, matches: Matches,
    step: float = 0.0, warmer: float = 0.0,
) -> KnownCamera:  # fmt: skip
    """The camera after one more frame, whose attitude is eliminated.

        P^-1 <- (P + Q step)^-1 + H' S H,   H = [1, warmer 1]

    with the normal equations S of the camera's unknowns without the attitude, as in `calibrate`,
    and with its weights against false matches.

    step     second, since the frame before
    warmer   kelvin, above the reference temperature
    Returns  what is known; where too few stars are matched, with the time's change alone
    Accuracy  model: errors of centroids are independent from frame to frame; what lasts at a place
              of the field, beyond `prior.floor`, makes the covariance too small.
    """
    covariance = known.covariance + np.diag(settings.walk(known.camera) ** 2 * step)
    known = replace(known, covariance=covariance)
    if len(matches) < FEWEST:
        return known
    # In units of the prior, so that the numbers of all unknowns are alike.
    scale = settings.sigma(known.camera)
    free = np.flatnonzero(scale > 0)
    scale = scale[free]
    before = np.linalg.inv(covariance[np.ix_(free, free)] / np.outer(scale, scale))
    view = np.hstack([np.eye(COUNT), warmer * np.eye(COUNT)])[:, free] * scale
    frame, moved = MatchedFrame(spots, matches), np.zeros(len(free))
    unknowns: Ints = np.arange(COUNT)
    normal = before
    for _ in range(STEPS):
        camera = moved_camera(known.at(warmer), unknowns, view @ moved)
        block = frame.normal(camera, unknowns, settings.prior.floor)
        normal = before + view.T @ block.schur @ view
        change = np.linalg.solve(normal, view.T @ block.right - before @ moved)
        frame.turn(block.attitude(view @ change))
        moved = moved + change
    full = np.zeros(2 * COUNT)
    full[free] = moved * scale
    covariance = np.zeros_like(covariance)
    covariance[np.ix_(free, free)] = np.linalg.inv(normal) * np.outer(scale, scale)
    return KnownCamera(
        moved_camera(known.camera, unknowns, full[:COUNT]), known.slope + full[COUNT:], covariance
    )
