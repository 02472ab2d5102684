"""Sequence: how the platform turns, how often a frame is taken, and what the filter leans on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from startrack.core import Unit, arcsec, deg, finite, non_negative, positive, whole
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
    """A gyroscope, the same on each axis; the filter knows these numbers, not what was drawn.

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
               design's motion, whose jitter goes on
    period     second from one frame to the next; None: as fast as the detector gives them
    gyro       None: the filter estimates the rate from the attitudes alone
    agility    radian / second^(3/2), white noise of angular acceleration that a filter without
               gyroscope reckons with
    swiftness  radian / second, rms of the rate that it reckons with at the start
    patience   frames without attitude after which the prediction is given up
    """

    legs: tuple[Leg, ...]
    period: Annotated[float | None, Unit("s")] = None
    gyro: Gyro | None = None
    agility: Annotated[float, Unit("rad/s(3/2)", "deg/s(3/2)")] = 60 * arcsec
    swiftness: Annotated[float, Unit("rad/s", "deg/s")] = 1 * deg
    patience: int = 3

    def __post_init__(self) -> None:
        if not self.legs:
            raise ValueError("legs must hold at least one leg, got none")
        if self.period is not None:
            positive(period=self.period)
        positive(agility=self.agility, swiftness=self.swiftness)
        whole(0, 10**6, patience=self.patience)

    @property
    def duration(self) -> float:
        """Second, of all legs."""
        return math.fsum(leg.duration for leg in self.legs)


def load_sequence(path: Path) -> Sequence:
    """Read a sequence from TOML, units in strings.

    Errors  ValueError, one sentence with the file, the place in it, the rule and the value.
    """
    table = read_table(path, "a sequence file")
    try:
        return from_table(Sequence, table)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
