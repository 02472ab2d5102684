"""Mounting: orientation of the camera on the spacecraft, with its thermo-elastic error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from scipy.spatial.transform import Rotation

from startrack.core import FINITE, NON_NEGATIVE, Parameters, Unit

SWING = "amplitude of the thermo-elastic error, one sinusoid per orbit; a trial has a random phase"
BIAS = "rotation vector in camera axes"


@dataclass(frozen=True)
class Mounting(Parameters):
    """Rotation from the camera's axes to the spacecraft's reference axes.

        camera_to_body = exp([angle + swing sin(phase)] x)

    The error of the known angle is the bias of ECSS-E-ST-60-20C, the swing its thermo-elastic
    error: a sinusoid models the heating and cooling during an orbit.

    Raises  ValueError where an angle is not finite or an amplitude is negative.
    """

    x: Annotated[float, Unit("rad", "arcsec"), FINITE, BIAS] = 0.0
    y: Annotated[float, Unit("rad", "arcsec"), FINITE, BIAS] = 0.0
    z: Annotated[float, Unit("rad", "arcsec"), FINITE, BIAS] = 0.0
    swing_x: Annotated[float, Unit("rad", "arcsec"), NON_NEGATIVE, SWING] = 0.0
    swing_y: Annotated[float, Unit("rad", "arcsec"), NON_NEGATIVE, SWING] = 0.0
    swing_z: Annotated[float, Unit("rad", "arcsec"), NON_NEGATIVE, SWING] = 0.0

    @property
    def swings(self) -> bool:
        """Whether the orientation changes."""
        return bool(self.swing_x or self.swing_y or self.swing_z)

    @property
    def still(self) -> Mounting:
        """The mounting without its swing."""
        return replace(self, swing_x=0.0, swing_y=0.0, swing_z=0.0)

    def camera_to_body(self, phase: float = 0.0) -> Rotation:
        """The rotation at a phase (radian) of the swing."""
        sine = math.sin(phase)
        return Rotation.from_rotvec(
            [
                self.x + self.swing_x * sine,
                self.y + self.swing_y * sine,
                self.z + self.swing_z * sine,
            ]
        )
