"""Sequence: profile of the platform, period of the frames, and settings of the filter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from startrack.core import Refused, Unit, arcsec, deg, finite, non_negative, positive, whole
from startrack.io import from_table, read_table


@dataclass(frozen=True)
class Leg:
    """A time in which the camera turns at constant rates about its own axes."""

    duration: Annotated[float, Unit("s")]
    rate_x: Annotated[float, Unit("rad/s", "deg/s")] = 0.0
    rate_y: Annotated[float, Unit("rad/s", "deg/s")] = 0.0
    rate_z: Annotated[float, Unit("rad/s", "deg/s")] = 0.0

    def __post_init__(self) -> None:
        positive(duration=self.duration)
        finite(rate_x=self.rate_x, rate_y=self.rate_y, rate_z=self.rate_z)


@dataclass(frozen=True)
class Gyro:
    """A gyroscope, the same on each axis; the filter knows these numbers, not the drawn errors.

    angle_random_walk  radian / second^(1/2), white noise of the rate
    rate_random_walk   radian / second^(3/2), white noise that drives the bias
    bias               radian / second, rms of the bias at the start
    """

    angle_random_walk: Annotated[float, Unit("rad/s(1/2)", "deg/h(1/2)")]
    rate_random_walk: Annotated[float, Unit("rad/s(3/2)", "deg/h(3/2)")]
    bias: Annotated[float, Unit("rad/s", "deg/h")]

    def __post_init__(self) -> None:
        non_negative(
            angle_random_walk=self.angle_random_walk,
            rate_random_walk=self.rate_random_walk,
            bias=self.bias,
        )


@dataclass(frozen=True)
class Sequence:
    """Frames in a row.

    legs       of the attitude profile, one after the other; they replace the rates of the
               design's motion, whose jitter remains
    period     second from one frame to the next; None: as fast as the detector gives them
    gyro       None: the filter estimates the rate from the attitudes alone
    angular_acceleration_psd  radian / second^(3/2), square root of the spectral density of the
               angular acceleration that a filter without gyroscope assumes
    initial_rate_sigma  radian / second, rms rate that the filter assumes at the start
    max_coasted_frames  frames without attitude after which the prediction is dropped
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "patience": "max_coasted_frames",
        "agility": "angular_acceleration_psd",
        "swiftness": "initial_rate_sigma",
    }

    legs: tuple[Leg, ...]
    period: Annotated[float | None, Unit("s")] = None
    gyro: Gyro | None = None
    angular_acceleration_psd: Annotated[float, Unit("rad/s(3/2)", "deg/s(3/2)")] = 60 * arcsec
    initial_rate_sigma: Annotated[float, Unit("rad/s", "deg/s")] = 1 * deg
    max_coasted_frames: int = 3

    def __post_init__(self) -> None:
        if not self.legs:
            raise Refused("legs must hold at least one leg, got none")
        if self.period is not None:
            positive(period=self.period)
        positive(
            angular_acceleration_psd=self.angular_acceleration_psd,
            initial_rate_sigma=self.initial_rate_sigma,
        )
        whole(0, 10**6, max_coasted_frames=self.max_coasted_frames)

    @property
    def duration(self) -> float:
        """Second, of all legs."""
        return math.fsum(leg.duration for leg in self.legs)


def load_sequence(path: Path) -> Sequence:
    """Read a sequence from TOML, units in strings.

    Raises  ValueError, one sentence with the file, the key in it, the rule and the value.
    """
    table = read_table(path, "a sequence file")
    try:
        return from_table(Sequence, table)
    except ValueError as error:
        raise Refused(f"{path}: {error}") from None
