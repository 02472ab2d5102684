"""Mounting: how the camera sits on the spacecraft, and how that swings with the heat."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from scipy.spatial.transform import Rotation

from startrack.core import Unit, finite, non_negative


@dataclass(frozen=True)
class Mounting:
    """The turn from the camera's axes to those that the spacecraft measures by.

        camera_to_body = exp([angle + swing sin(phase)] x)

    What the tracker does not know of the angle is the bias of ECSS-E-ST-60-20C, the swing its
    thermo-elastic error: a sinusoid stands for the warming and cooling of an orbit.

    x, y, z           radian, rotation vector in camera axes
    swing_x, _y, _z   radian, amplitude of the thermo-elastic swing, one sinusoid an orbit; a trial
                      comes at a random time of it
    """

    x: Annotated[float, Unit("rad", "arcsec")] = 0.0
    y: Annotated[float, Unit("rad", "arcsec")] = 0.0
    z: Annotated[float, Unit("rad", "arcsec")] = 0.0
    swing_x: Annotated[float, Unit("rad", "arcsec")] = 0.0
    swing_y: Annotated[float, Unit("rad", "arcsec")] = 0.0
    swing_z: Annotated[float, Unit("rad", "arcsec")] = 0.0

    def __post_init__(self) -> None:
        finite(x=self.x, y=self.y, z=self.z)
        non_negative(swing_x=self.swing_x, swing_y=self.swing_y, swing_z=self.swing_z)

    @property
    def swings(self) -> bool:
        """Whether it changes at all."""
        return bool(self.swing_x or self.swing_y or self.swing_z)

    @property
    def still(self) -> Mounting:
        """The same without its swing."""
        return replace(self, swing_x=0.0, swing_y=0.0, swing_z=0.0)

    def camera_to_body(self, phase: float = 0.0) -> Rotation:
        """The turn at a phase (radian) of the swing."""
        sine = math.sin(phase)
        return Rotation.from_rotvec(
            [
                self.x + self.swing_x * sine,
                self.y + self.swing_y * sine,
                self.z + self.swing_z * sine,
            ]
        )
