"""SolverSettings: errors assumed of centroids; Mounting: the camera on the spacecraft."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import FINITE, NON_NEGATIVE, POSITIVE, Parameters, Range, Unit, parameter

# Pixel per axis, typical systematic error of calibrated cameras. Chosen by hand: a larger one gives
# all stars nearly the same weight; with a smaller one the stated covariance of bright stars is too
# small.
UNKNOWN_FLOOR = 0.015


METHODS = ("least squares",)
SWING = "amplitude of the thermo-elastic error, one sinusoid per orbit; a trial has a random phase"
BIAS = "rotation vector in camera axes"


class SolverSettings(Parameters):
    """Weights of matched stars, and the rule for leaving out a star.

    Raises  ValueError if the floor is negative or the gate is not positive.
    """

    centroid_floor: float | None = parameter(
        "pixel, systematic error per axis of every centroid in addition to its noise: sampling by "
        "pixels, their unequal response, light of other stars; None: the prediction of the "
        "design for each star, or 0.015 without a design",
        limit=NON_NEGATIVE,
        default=None,
    )
    gate: float = parameter(
        "sigma, normalised residual beyond which a star is left out as a false match, a double "
        "star or a hot pixel; scaled with the residuals if these are larger than the noise "
        "explains. Chosen by hand: a smaller one loses stars, a larger one keeps outliers",
        limit=POSITIVE,
        default=5.0,
    )
    sift: bool = parameter(
        "whether the solver first takes the largest set of stars that agree on one attitude within "
        "the gate, however small the set is; for matches that were not verified together",
        default=False,
    )
    method: str = parameter(
        '"least squares": by the residuals in the image plane; or user code, see '
        "docs/extensions.md. User code also handles outliers: gate and sift are not used",
        limit=Range(choices=METHODS, code="attitudes"),
        default="least squares",
    )


class Mounting(Parameters):
    """Rotation from the camera's axes to the spacecraft's reference axes.

        camera_to_body = exp([angle + swing sin(phase)] x)

    In ECSS-E-ST-60-20C, the error of the known angle is the bias, and the swing is the
    thermo-elastic error. A sinusoid models the heating and cooling during an orbit.

    Raises  ValueError if an angle is not finite or an amplitude is negative.
    """

    x: float = parameter(BIAS, unit=Unit("rad", "arcsec"), limit=FINITE, default=0.0)
    y: float = parameter(BIAS, unit=Unit("rad", "arcsec"), limit=FINITE, default=0.0)
    z: float = parameter(BIAS, unit=Unit("rad", "arcsec"), limit=FINITE, default=0.0)
    swing_x: float = parameter(SWING, unit=Unit("rad", "arcsec"), limit=NON_NEGATIVE, default=0.0)
    swing_y: float = parameter(SWING, unit=Unit("rad", "arcsec"), limit=NON_NEGATIVE, default=0.0)
    swing_z: float = parameter(SWING, unit=Unit("rad", "arcsec"), limit=NON_NEGATIVE, default=0.0)

    @property
    def swings(self) -> bool:
        """Whether the orientation changes."""
        return bool(self.swing_x or self.swing_y or self.swing_z)

    @property
    def still(self) -> Mounting:
        """The mounting without its swing."""
        return replace(self, swing_x=0.0, swing_y=0.0, swing_z=0.0) if self.swings else self

    def camera_to_body(self, phase: float = 0.0) -> Rotation:
        """The rotation at a phase (radian) of the swing."""
        swing = np.array([self.swing_x, self.swing_y, self.swing_z]) * math.sin(phase)
        return Rotation.from_rotvec(np.array([self.x, self.y, self.z]) + swing)
