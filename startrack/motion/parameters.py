"""Motion: rates, tones and broadband jitter of the platform."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
)

AXES = ("x", "y", "z")


LEAD = "phase of y and z ahead of x: -90 deg makes a circle"
TONE_RMS = "root mean square about each of the camera's axes"


class Tone(Parameters):
    """Sinusoidal jitter, for example of a reaction wheel or a cooler.

        angle about an axis = sqrt(2) rms cos(2 pi frequency t + phase + lead),   t = 0 mid-exposure

    All axes of the camera have the same frequency and phase.
    """

    frequency: float = parameter("of the sinusoid", unit=Unit("Hz"), limit=POSITIVE)
    rms_x: float = parameter(TONE_RMS, unit=Unit("rad", "arcsec"), limit=NON_NEGATIVE, default=0.0)
    rms_y: float = parameter(TONE_RMS, unit=Unit("rad", "arcsec"), limit=NON_NEGATIVE, default=0.0)
    rms_z: float = parameter(TONE_RMS, unit=Unit("rad", "arcsec"), limit=NON_NEGATIVE, default=0.0)
    phase: float | None = parameter(
        "radian; None: random in each trial", unit=Unit("rad", "deg"), limit=FINITE, default=None
    )
    lead_y: float = parameter(LEAD, unit=Unit("rad", "deg"), limit=FINITE, default=0.0)
    lead_z: float = parameter(LEAD, unit=Unit("rad", "deg"), limit=FINITE, default=0.0)

    @property
    def silent(self) -> bool:
        """Whether the amplitude is zero."""
        return not (self.rms_x or self.rms_y or self.rms_z)


class Broadband(Parameters):
    """Random jitter about one axis, with a power spectral density (PSD) given as a table.

    Between the points of the table the density is a power law (linear in logarithms), as in
    specifications of vibration. Outside the table it is zero. The integral is the rms squared.
    """

    axis: str = parameter("axis of the camera: x, y or z", limit=Range(choices=AXES))
    frequency: tuple[float, ...] = parameter("increasing", unit=Unit("Hz"), limit=POSITIVE)
    density: tuple[float, ...] = parameter(
        "one-sided", unit=Unit("rad2 / Hz", "arcsec2 / Hz"), limit=POSITIVE
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.frequency) != len(self.density) or len(self.frequency) < 2:
            raise Refused(
                "frequency and density must have the same length of two or more, got "
                f"{len(self.frequency)} and {len(self.density)}"
            )
        if any(low >= high for low, high in pairwise(self.frequency)):
            raise Refused(f"frequency must increase, got {self.frequency}")


RATE = "rates about the axes along columns and rows; they smear stars along y and x"


class Motion(Parameters):
    """Motion of the camera in an exposure, about its own axes."""

    rate_x: float = parameter(RATE, unit=Unit("rad/s", "deg/s"), limit=FINITE, default=0.0)
    rate_y: float = parameter(RATE, unit=Unit("rad/s", "deg/s"), limit=FINITE, default=0.0)
    rate_z: float = parameter(
        "rate about the boresight; it smears stars around it",
        unit=Unit("rad/s", "deg/s"),
        limit=FINITE,
        default=0.0,
    )
    tones: tuple[Tone, ...] = parameter(
        "sinusoidal jitter; a tone without amplitude does not change the draws of the others",
        default=(),
    )
    broadband: tuple[Broadband, ...] = parameter(
        "random jitter, at most one spectrum for each axis", default=()
    )
    jitter: tuple[str, ...] = parameter(
        "user code that draws lines of jitter in each trial; see docs/extensions.md",
        limit=Range(code="jitters"),
        default=(),
    )
    jitter_of: str = parameter(
        '"platform": tones, broadband and jitter move the spacecraft with all its heads; fusion '
        'does not reduce them, and they are no noise of the sensor; "head": they move the '
        "mount of the head, independently of other heads",
        limit=Range(choices=("platform", "head")),
        default="platform",
    )
    jitter_factor: float = parameter(
        "factor of the angles of all tones, spectra and user code: one number for the level of a "
        "spectrum, such as a variable of a campaign or a damper's transmission; densities grow "
        "with its square",
        limit=NON_NEGATIVE,
        default=1.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        axes = [spectrum.axis for spectrum in self.broadband]
        if len(set(axes)) < len(axes):
            raise Refused(
                f"broadband must have at most one spectrum for each axis, got {', '.join(axes)}"
            )

    @property
    def rates(self) -> Floats:
        """Rotation rates (3,), radian / second."""
        return np.array([self.rate_x, self.rate_y, self.rate_z])

    @property
    def rate(self) -> float:
        """Length of the rate vector, radian / second."""
        return math.hypot(self.rate_x, self.rate_y, self.rate_z)

    @property
    def steady(self) -> Motion:
        """The motion without jitter: rates alone."""
        return replace(self, tones=(), broadband=(), jitter=(), jitter_factor=1.0)

    @property
    def jitters(self) -> bool:
        """Whether the motion has jitter."""
        return bool(self.jitter_factor and (self.tones or self.broadband or self.jitter))

    @property
    def drawn(self) -> bool:
        """Whether the motion is random in each trial."""
        return self.jitters and (
            bool(self.broadband or self.jitter)
            or any(tone.phase is None and not tone.silent for tone in self.tones)
        )
