"""CameraCalibration: how the camera model of each unit is measured, on the ground or in orbit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from startrack.core import Refused, Unit, finite, non_negative, one_of, whole

PLACES = ("ground", "orbit")
ORDERS = (1, 3, 5, 7)


@dataclass(frozen=True)
class CameraCalibration:
    """A calibration of the camera of one unit: a least-squares fit to stars at known directions.

    On the ground, a collimator or a star simulator shows stars at `positions` evenly over the
    frame, in one attitude of the camera that is fitted too. In orbit, `frames` of random sky have
    `stars` each, at random places, and an attitude each.

    place       "ground": before launch, so that steps of the launch come after; "orbit": after it
    positions   on the ground
    frames      in orbit
    stars       in each of these frames
    noise       pixel rms per axis, of the mean centroid of a star at a position, or in a frame
    direction   radian rms per axis, error of the direction of a position of the collimator
    temperature  kelvin, of the instrument above its reference, at which the residual is seen
    order       of the polynomial of distortion in the fit: 1: focal length and principal point
                alone; 3: k1 too; 5: and k2; 7: and k3
    tangential  whether p1 and p2 are fitted too
    """

    place: str = "ground"
    positions: int = 100
    frames: int = 50
    stars: int = 10
    noise: float = 0.02
    direction: Annotated[float, Unit("rad", "arcsec")] = 0.0
    temperature: Annotated[float, Unit("K")] = 0.0
    order: int = 3
    tangential: bool = False

    def __post_init__(self) -> None:
        one_of(PLACES, place=self.place)
        whole(10, 10**5, positions=self.positions)
        whole(1, 10**5, frames=self.frames)
        whole(3, 1000, stars=self.stars)
        non_negative(noise=self.noise, direction=self.direction)
        finite(temperature=self.temperature)
        if self.order not in ORDERS:
            raise Refused(f"order must be 1, 3, 5 or 7, got {self.order}")
