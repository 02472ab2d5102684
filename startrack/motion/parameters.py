"""Motion: rates, tones and broadband jitter of the platform."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np

from startrack.core import FINITE, NON_NEGATIVE, POSITIVE, Floats, Parameters, Range, Refused, Unit

AXES = ("x", "y", "z")


LEAD = "phase of these axes ahead of x: -90 deg makes a circle"
TONE_RMS = "root mean square about each of the camera's axes"


@dataclass(frozen=True)
class Tone(Parameters):
    """A sinusoidal jitter, such as that of a reaction wheel or a cooler.

        angle about an axis = sqrt(2) rms cos(2 pi frequency t + phase + lead),   t = 0 mid-exposure

    About all axes of the camera it has one frequency and one phase.
    """

    frequency: Annotated[float, Unit("Hz"), POSITIVE, "of the sinusoid"]
    rms_x: Annotated[float, Unit("rad", "arcsec"), NON_NEGATIVE, TONE_RMS] = 0.0
    rms_y: Annotated[float, Unit("rad", "arcsec"), NON_NEGATIVE, TONE_RMS] = 0.0
    rms_z: Annotated[float, Unit("rad", "arcsec"), NON_NEGATIVE, TONE_RMS] = 0.0
    phase: Annotated[
        float | None, Unit("rad", "deg"), FINITE, "radian; None: random in each trial"
    ] = None
    lead_y: Annotated[float, Unit("rad", "deg"), FINITE, LEAD] = 0.0
    lead_z: Annotated[float, Unit("rad", "deg"), FINITE, LEAD] = 0.0

    @property
    def silent(self) -> bool:
        """Whether it has no amplitude."""
        return not (self.rms_x or self.rms_y or self.rms_z)


@dataclass(frozen=True)
class Broadband(Parameters):
    """Random jitter about one axis, with a power spectral density (PSD) given as a table.

    Between its points the density is a power law (linear in logarithms), as vibration levels are
    specified; outside them it is zero. Its integral is the rms squared.
    """

    axis: Annotated[str, Range(choices=AXES), "x, y or z, of the camera"]
    frequency: Annotated[tuple[float, ...], Unit("Hz"), POSITIVE, "increasing"]
    density: Annotated[tuple[float, ...], Unit("rad2 / Hz", "arcsec2 / Hz"), POSITIVE, "one-sided"]

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


@dataclass(frozen=True)
class Motion(Parameters):
    """How the camera turns in an exposure, about its own axes."""

    rate_x: Annotated[float, Unit("rad/s", "deg/s"), FINITE, RATE] = 0.0
    rate_y: Annotated[float, Unit("rad/s", "deg/s"), FINITE, RATE] = 0.0
    rate_z: Annotated[
        float, Unit("rad/s", "deg/s"), FINITE, "about the boresight: it smears stars around it"
    ] = 0.0
    tones: Annotated[
        tuple[Tone, ...],
        "sinusoidal jitter; one without amplitude does not change the draws of the others",
    ] = ()
    broadband: Annotated[
        tuple[Broadband, ...], "random jitter, at most one spectrum for each axis"
    ] = ()
    jitter: Annotated[
        tuple[str, ...],
        Range(code="jitters"),
        "code of one's own that draws lines of jitter in each trial, see docs/extensions.md",
    ] = ()
    jitter_of: Annotated[
        str,
        Range(choices=("platform", "head")),
        '"platform": tones, broadband and jitter are of the spacecraft: one motion of all of its '
        'heads, which no fusion reduces, and no noise of the sensor; "head": of its own mount, '
        "independent of other heads'",
    ] = "platform"

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
        return replace(self, tones=(), broadband=(), jitter=())

    @property
    def jitters(self) -> bool:
        """Whether more than the rates moves the camera."""
        return bool(self.tones or self.broadband or self.jitter)

    @property
    def drawn(self) -> bool:
        """Whether each trial has its own random motion."""
        return bool(self.broadband or self.jitter) or any(
            tone.phase is None and not tone.silent for tone in self.tones
        )
