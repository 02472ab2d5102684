"""Motion: the rates of the platform."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from startrack.checks import finite
from startrack.units import Unit


@dataclass(frozen=True)
class Motion:
    """Constant angular rate of the camera, about its own axes.

    rate_x, rate_y  radian / second, about the axes along the columns and rows: they smear stars
                    along y and x
    rate_z          radian / second, about the boresight: it smears stars around it
    """

    rate_x: Annotated[float, Unit("rad/s", "deg/s")] = 0.0
    rate_y: Annotated[float, Unit("rad/s", "deg/s")] = 0.0
    rate_z: Annotated[float, Unit("rad/s", "deg/s")] = 0.0

    def __post_init__(self) -> None:
        finite(rate_x=self.rate_x, rate_y=self.rate_y, rate_z=self.rate_z)

    @property
    def rate(self) -> float:
        """Radian / second, length of the rate vector."""
        return math.hypot(self.rate_x, self.rate_y, self.rate_z)
