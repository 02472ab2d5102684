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


LEAD = "phase of these axes ahead of x: -90 deg makes a circle"
TONE_RMS = "root mean square about each of the camera's axes"


class Tone(Parameters):
    """A sinusoidal jitter, such as that of a reaction wheel or a cooler.

        angle about an axis = sqrt(2) rms cos(2 pi frequency t + phase + lead),   t = 0 mid-exposure

    About all axes of the camera it has one frequency and one phase.
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
        """Whether it has no amplitude."""
        return not (self.rms_x or self.rms_y or self.rms_z)


class Broadband(Parameters):
    """Random jitter about one axis, with a power spectral density (PSD) given as a table.

    Between its points the density is a power law (linear in logarithms), as vibration levels are
    specified; outside them it is zero. Its integral is the rms squared.
    """

    axis: str = parameter("x, y or z, of the camera", limit=Range(choices=AXES))
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


RATE = "about the axes along the columns and rows: they smear stars along y and x"


class Motion(Parameters):
    """Motion of the camera in an exposure, about its own axes."""

    rate_x: float = parameter(RATE, unit=Unit("rad/s", "deg/s"), limit=FINITE, default=0.0)
    rate_y: float = parameter(RATE, unit=Unit("rad/s", "deg/s"), limit=FINITE, default=0.0)
    rate_z: float = parameter(
        "about the boresight: it smears stars around it",
        unit=Unit("rad/s", "deg/s"),
        limit=FINITE,
        default=0.0,
    )
    tones: tuple[Tone, ...] = parameter(
        "sinusoidal jitter; one without amplitude does not change the draws of the others",
        default=(),
    )
    broadband: tuple[Broadband, ...] = parameter(
        "random jitter, at most one spectrum for each axis", default=()
    )
    jitter: tuple[str, ...] = parameter(
        "user code that draws lines of jitter in each trial, see docs/extensions.md",
        limit=Range(code="jitters"),
        default=(),
    )
    jitter_of: str = parameter(
        '"platform": tones, broadband and jitter are of the spacecraft: one motion of all of its '
        'heads, which no fusion reduces, and no noise of the sensor; "head": of its own mount, '
        "independent of other heads'",
        limit=Range(choices=("platform", "head")),
        default="platform",
    )
    jitter_factor: float = parameter(
        "on the angles of all tones, spectra and code of jitter: the level of a whole spectrum by "
        "one number, such as a variable of a campaign or a damper's transmission; densities grow "
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
        """Radian / second (3,)."""
        return np.array([self.rate_x, self.rate_y, self.rate_z])

    @property
    def rate(self) -> float:
        """Radian / second, length of the rate vector."""
        return math.hypot(self.rate_x, self.rate_y, self.rate_z)

    @property
    def steady(self) -> Motion:
        """The same without jitter: its rates alone."""
        return replace(self, tones=(), broadband=(), jitter=(), jitter_factor=1.0)

    @property
    def jitters(self) -> bool:
        """Whether more than the rates moves the camera."""
        return bool(self.jitter_factor and (self.tones or self.broadband or self.jitter))

    @property
    def drawn(self) -> bool:
        """Whether each trial has its own random motion."""
        return self.jitters and (
            bool(self.broadband or self.jitter)
            or any(tone.phase is None and not tone.silent for tone in self.tones)
        )
