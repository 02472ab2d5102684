"""Sequence: profile of the platform, period of the frames, and settings of the filter."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude import CameraFilter
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Parameters,
    Range,
    Refused,
    Unit,
    deg,
    parameter,
    printed,
)
from startrack.io import from_table, read_table
from startrack.motion import Tone

TURN = "of the rotation vector, about the axes of the camera of the design"


class Leg(Parameters):
    """A time in which the camera turns at constant rates about its own axes."""

    duration: float = parameter("of the leg", unit=Unit("s"), limit=POSITIVE)
    rate_x: float = parameter(
        "about the x axis of the camera", unit=Unit("rad/s", "deg/s"), limit=FINITE, default=0.0
    )
    rate_y: float = parameter(
        "about its y axis", unit=Unit("rad/s", "deg/s"), limit=FINITE, default=0.0
    )
    rate_z: float = parameter(
        "about its boresight", unit=Unit("rad/s", "deg/s"), limit=FINITE, default=0.0
    )


class Gyro(Parameters):
    """A gyroscope with three equal axes; the filter knows these numbers, not the drawn errors."""

    angle_random_walk: float = parameter(
        "radian / second^(1/2), white noise of the rate",
        unit=Unit("rad/s(1/2)", "deg/h(1/2)"),
        limit=NON_NEGATIVE,
    )
    rate_random_walk: float = parameter(
        "radian / second^(3/2), white noise that drives the bias",
        unit=Unit("rad/s(3/2)", "deg/h(3/2)"),
        limit=NON_NEGATIVE,
    )
    bias: float = parameter(
        "rms of the bias at the start", unit=Unit("rad/s", "deg/h"), limit=NON_NEGATIVE
    )
    misalignment: float = parameter(
        "rms rotation of its axes from those of the camera, about each of them; the filter "
        "estimates it from the slews",
        unit=Unit("rad", "arcsec"),
        limit=NON_NEGATIVE,
        default=0.0,
    )


class SequenceHead(Parameters):
    """A further head of the tracker: another camera of the same make on the same bench.

    Its axes are those of the design's camera, turned by the rotation vector (x, y, z) about them.
    Its detector and the residual of its lens have separate seeds.
    """

    x: float = parameter(TURN, unit=Unit("rad", "deg"), limit=FINITE, default=0.0)
    y: float = parameter(TURN, unit=Unit("rad", "deg"), limit=FINITE, default=0.0)
    z: float = parameter(TURN, unit=Unit("rad", "deg"), limit=FINITE, default=0.0)
    alignment_sigma: float = parameter(
        "rms error of that rotation about each axis, drawn for each sequence; the filter "
        "estimates it from the attitudes of both heads",
        unit=Unit("rad", "arcsec"),
        limit=NON_NEGATIVE,
        default=0.0,
    )

    @property
    def to_head(self) -> Rotation:
        """The believed rotation from the camera's axes to those of the head."""
        return Rotation.from_rotvec([-self.x, -self.y, -self.z])


@printed
class Sequence(Parameters):
    """Frames in a row."""

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "patience": "max_coasted_frames",
        "agility": "angular_acceleration_psd",
        "swiftness": "initial_rate_sigma",
    }

    legs: tuple[Leg, ...] = parameter(
        "of the attitude profile, one after the other; they replace the rates of the design's "
        "motion, whose jitter remains"
    )
    period: float | None = parameter(
        "from one frame to the next; None: as fast as the detector gives them",
        unit=Unit("s"),
        limit=POSITIVE,
        default=None,
    )
    gyro: Gyro | None = parameter(
        "None: the filter estimates the rate from the attitudes alone", default=None
    )
    angular_acceleration_psd: float = parameter(
        "radian / second^(3/2), square root of the spectral density of the angular acceleration "
        "that a filter without gyroscope assumes",
        unit=Unit("rad/s(3/2)", "deg/s(3/2)"),
        limit=POSITIVE,
        default=60 * core.arcsec,
    )
    initial_rate_sigma: float = parameter(
        "rms rate that the filter assumes at the start, and when a frame has no attitude: a "
        "manoeuvre may have begun",
        unit=Unit("rad/s", "deg/s"),
        limit=POSITIVE,
        default=1 * deg,
    )
    max_coasted_frames: int = parameter(
        "frames without attitude after which the prediction is dropped",
        limit=Range(0, 10**6),
        default=3,
    )
    heads: tuple[SequenceHead, ...] = parameter(
        "further heads, whose frames are taken at the same times; one filter has the attitudes of "
        "all",
        default=(),
    )
    camera: CameraFilter | None = parameter(
        "calibrates the tracker's camera from frame to frame; None: it keeps what it believes",
        default=None,
    )
    dither: tuple[Tone, ...] = parameter(
        "sinusoidal motion beside the legs and the design's jitter, such as that of a spacecraft "
        "that moves its image over the pixels; of one start in a sequence",
        default=(),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.legs:
            raise Refused("legs must hold at least one leg, got none")
        if self.camera and (self.camera.focal_length_slope or self.camera.principal_slope):
            raise Refused(
                "camera.focal_length_slope and camera.principal_slope must be 0 in a sequence, "
                f"which has one temperature, got {self.camera.focal_length_slope:g} / K and "
                f"{self.camera.principal_slope:g}"
            )

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
