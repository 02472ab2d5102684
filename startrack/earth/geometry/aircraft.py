"""An aircraft in level flight and times -> where it is over the turning Earth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Unit, finite, positive, within
from startrack.earth.terrain import cartesian, up


@dataclass(frozen=True)
class Aircraft:
    """A great circle at one height, flown at one speed over ground.

    epoch                UTC, as ISO 8601
    longitude, latitude  radian, where it is at the epoch
    altitude             metre above the ellipsoid
    heading              radian, from north to east
    speed                metre / second, over ground
    """

    epoch: str
    longitude: Annotated[float, Unit("rad", "deg")]
    latitude: Annotated[float, Unit("rad", "deg")]
    altitude: Annotated[float, Unit("m", "km")] = 3e3
    heading: Annotated[float, Unit("rad", "deg")] = 0.0
    speed: Annotated[float, Unit("m / s")] = 80.0

    def __post_init__(self) -> None:
        finite(longitude=self.longitude, heading=self.heading)
        within(-1.5, 1.5, latitude=self.latitude)  # at the poles a heading has no sense
        within(1.0, 100e3, altitude=self.altitude)
        positive(speed=self.speed)

    def places(self, second: Floats) -> tuple[Floats, Floats]:
        """Positions in metre and velocities over ground in metre / second, (n, 3) each, ITRS.

        Accuracy  model: a circle through the first place about the Earth's axis of that heading,
                  which leaves the ellipsoid's height by 5 m at most after 100 km.
        """
        here = np.array([self.longitude]), np.array([self.latitude])
        start = cartesian(*here, np.array([self.altitude]))[0]
        vertical = up(*here)[0]
        east = np.array([-math.sin(self.longitude), math.cos(self.longitude), 0.0])
        along = math.sin(self.heading) * east + math.cos(self.heading) * np.cross(vertical, east)
        # The circle's centre lies under the place, so that height and heading stay.
        radius = float(start @ vertical)
        axis = np.cross(vertical, along)
        turn = Rotation.from_rotvec(np.outer(second * self.speed / radius, axis))
        centre = start - radius * vertical
        return centre + turn.apply(radius * vertical), turn.apply(self.speed * along)
