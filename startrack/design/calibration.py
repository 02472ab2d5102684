"""CameraCalibration: how the camera model of each unit is measured, on the ground or in orbit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from startrack.core import FINITE, NON_NEGATIVE, Parameters, Range, Refused, Unit

PLACES = ("ground", "orbit")
ORDERS = (1, 3, 5, 7)


@dataclass(frozen=True)
class CameraCalibration(Parameters):
    """A calibration of the camera of one unit: a least-squares fit to stars at known directions.

    On the ground, a collimator or a star simulator shows stars at `positions` evenly over the
    frame, in one attitude of the camera that is fitted too. In orbit, `frames` of random sky have
    `stars` each, at random places, and an attitude each.
    """

    place: Annotated[str, Range(choices=PLACES),
        '"ground": before launch, so that steps of the launch come after; "orbit": after it'
    ] = "ground"  # fmt: skip
    positions: Annotated[int, Range(10, 10**5), "on the ground"] = 100
    frames: Annotated[int, Range(1, 10**5), "in orbit"] = 50
    stars: Annotated[int, Range(3, 1000), "in each of these frames"] = 10
    noise: Annotated[float, NON_NEGATIVE,
        "pixel rms per axis, of the mean centroid of a star at a position, or in a frame"
    ] = 0.02  # fmt: skip
    direction: Annotated[float, Unit("rad", "arcsec"), NON_NEGATIVE,
        "radian rms per axis, error of the direction of a position of the collimator"
    ] = 0.0  # fmt: skip
    temperature: Annotated[float, Unit("K"), FINITE,
        "of the instrument above its reference, at which the residual is seen"] = 0.0  # fmt: skip
    order: Annotated[int,
        "of the polynomial of distortion in the fit: 1: focal length and principal point alone; "
        "3: k1 too; 5: and k2; 7: and k3"] = 3  # fmt: skip
    tangential: Annotated[bool, "whether p1 and p2 are fitted too"] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.order not in ORDERS:
            raise Refused(f"order must be 1, 3, 5 or 7, got {self.order}")
