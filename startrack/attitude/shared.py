"""Errors that the stars of a frame share -> what they add to the covariance of an attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from startrack.attitude.refine import tangent
from startrack.core import Floats


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Errors that are alike for near stars, or for all, as far as a tracker knows their law.

    columns, rows  pixel, of the frame
    table          (q, p, 2, k) pixel, x and y at q x p places that span the frame: a root of their
                   covariance, table table^T over the k
    variance       pixel^2 per axis over the frame, which the systematic variance of stars contains
    turn           (3,) radian^2, of turns between camera and spacecraft about the camera's axes
    """

    columns: int
    rows: int
    table: Floats
    variance: float
    turn: Floats

    def at(self, pixel: Floats) -> Floats:
        """The root (..., 2, k) at places (..., 2) pixel: that of the nearest place of the table."""
        down, across = self.table.shape[:2]
        x = np.rint((pixel[..., 0] + 0.5) / self.columns * (across - 1)).astype(np.int64)
        y = np.rint((pixel[..., 1] + 0.5) / self.rows * (down - 1)).astype(np.int64)
        return self.table[np.clip(y, 0, down - 1), np.clip(x, 0, across - 1)]

    def added(self, gain: Floats, pixel: Floats) -> Floats:
        """What is added to a covariance that takes the errors of all stars as independent.

            G (S - variance 1) G^T + turn,   S = table table^T at the stars

        gain     (..., 3, n, 2) radian per pixel, of the attitude; zero for missing stars
        pixel    (..., n, 2)
        Returns  (..., 3, 3) radian^2
        Accuracy  model: to first order in the errors; turns about different axes are independent.
        """
        root, flat = self.at(pixel), gain.reshape(*gain.shape[:-2], -1)
        moved = flat @ root.reshape(*flat.shape[:-2], flat.shape[-1], -1)
        apart = self.variance * flat @ flat.swapaxes(-1, -2)
        return moved @ moved.swapaxes(-1, -2) - apart + np.diag(self.turn)


def attitude_gain(plane: Floats, inverse: Floats, focal: float, tolerance: float = 0.0) -> Floats:
    """Slope of the attitude that least squares find by the measured places of its stars.

        G = (H^T M H + P)^-1 H^T M

    with the slopes H of the places by a small rotation and, where it is estimated, by the scale.

    plane      (..., n, 2) places of the stars in the image plane
    inverse    (..., n, 2, 2) 1 / pixel^2, M: inverse covariances; zero for missing stars
    focal      pixel
    tolerance  1, prior standard deviation of the relative focal length; 0: it is held
    Returns    (..., 3, n, 2) radian per pixel
    """
    count = plane.shape[-2]
    slopes = focal * tangent(plane.reshape(-1, 2)).reshape(*plane.shape, 3)
    if tolerance:
        slopes = np.concatenate([slopes, focal * plane[..., None]], axis=-1)
    known = np.zeros(slopes.shape[-1])
    known[3:] = tolerance**-2 if tolerance else 0.0
    flat = slopes.reshape(*slopes.shape[:-3], 2 * count, -1)
    left = (inverse @ slopes).reshape(flat.shape).swapaxes(-1, -2)
    gain = np.linalg.solve(left @ flat + np.diag(known), left)
    return np.asarray(gain[..., :3, :].reshape(*gain.shape[:-2], 3, count, 2))
