"""Sequence: profile of the platform, period of the frames, and settings of the filter."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude import CameraFilter
from startrack.core import FINITE, NON_NEGATIVE, POSITIVE, Parameters, Range, Refused, Unit, deg
from startrack.io import from_table, read_table
from startrack.motion import Tone

TURN = "of the rotation vector, about the axes of the camera of the design"


@dataclass(frozen=True)
class Leg(Parameters):
    """A time in which the camera turns at constant rates about its own axes."""

    duration: Annotated[float, Unit("s"), POSITIVE]
    rate_x: Annotated[float, Unit("rad/s", "deg/s"), FINITE] = 0.0
    rate_y: Annotated[float, Unit("rad/s", "deg/s"), FINITE] = 0.0
    rate_z: Annotated[float, Unit("rad/s", "deg/s"), FINITE] = 0.0


@dataclass(frozen=True)
class Gyro(Parameters):
    """A gyroscope, the same on each axis; the filter knows these numbers, not the drawn errors."""

    angle_random_walk: Annotated[
        float,
        Unit("rad/s(1/2)", "deg/h(1/2)"),
        NON_NEGATIVE,
        "radian / second^(1/2), white noise of the rate",
    ]
    rate_random_walk: Annotated[
        float,
        Unit("rad/s(3/2)", "deg/h(3/2)"),
        NON_NEGATIVE,
        "radian / second^(3/2), white noise that drives the bias",
    ]
    bias: Annotated[float, Unit("rad/s", "deg/h"), NON_NEGATIVE, "rms of the bias at the start"]
    misalignment: Annotated[
        float,
        Unit("rad", "arcsec"),
        NON_NEGATIVE,
        "rms rotation of its axes from those of the camera, about each of them; the filter "
        "estimates it from the slews",
    ] = 0.0


@dataclass(frozen=True)
class Head(Parameters):
    """A further head of the tracker: another camera of the same make on the same bench.

    Its axes are those of the camera of the design, turned by the rotation vector (x, y, z) about
    these; its detector and the residual of its lens have seeds of their own.
    """

    x: Annotated[float, Unit("rad", "deg"), FINITE, TURN] = 0.0
    y: Annotated[float, Unit("rad", "deg"), FINITE, TURN] = 0.0
    z: Annotated[float, Unit("rad", "deg"), FINITE, TURN] = 0.0
    alignment_sigma: Annotated[
        float,
        Unit("rad", "arcsec"),
        NON_NEGATIVE,
        "rms error of that rotation about each axis, drawn for each sequence; the filter "
        "estimates it from the attitudes of both heads",
    ] = 0.0

    @property
    def to_head(self) -> Rotation:
        """The rotation from the camera's axes to those of the head, as it is known."""
        return Rotation.from_rotvec([-self.x, -self.y, -self.z])


@dataclass(frozen=True)
class Sequence(Parameters):
    """Frames in a row."""

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "patience": "max_coasted_frames",
        "agility": "angular_acceleration_psd",
        "swiftness": "initial_rate_sigma",
    }

    legs: Annotated[
        tuple[Leg, ...],
        "of the attitude profile, one after the other; they replace the rates of the design's "
        "motion, whose jitter remains",
    ]
    period: Annotated[
        float | None,
        Unit("s"),
        POSITIVE,
        "from one frame to the next; None: as fast as the detector gives them",
    ] = None
    gyro: Annotated[Gyro | None, "None: the filter estimates the rate from the attitudes alone"] = (
        None
    )
    angular_acceleration_psd: Annotated[
        float,
        Unit("rad/s(3/2)", "deg/s(3/2)"),
        POSITIVE,
        "radian / second^(3/2), square root of the spectral density of the angular acceleration "
        "that a filter without gyroscope assumes",
    ] = 60 * core.arcsec
    initial_rate_sigma: Annotated[
        float,
        Unit("rad/s", "deg/s"),
        POSITIVE,
        "rms rate that the filter assumes at the start, and when a frame has no attitude: a "
        "manoeuvre may have begun",
    ] = 1 * deg
    max_coasted_frames: Annotated[
        int, Range(0, 10**6), "frames without attitude after which the prediction is dropped"
    ] = 3
    heads: Annotated[
        tuple[Head, ...],
        "further heads, whose frames are taken at the same times; one filter has the attitudes of "
        "all",
    ] = ()
    camera: Annotated[
        CameraFilter | None,
        "calibrates the tracker's camera from frame to frame; None: it keeps what it believes",
    ] = None
    dither: Annotated[
        tuple[Tone, ...],
        "sinusoidal motion beside the legs and the design's jitter, such as of a spacecraft that "
        "moves its image over the pixels; of one start in a sequence",
    ] = ()

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
