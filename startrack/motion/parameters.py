"""Motion: rates, tones and broadband jitter of the platform."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

from startrack.core import (
    Refused,
    Unit,
    code_field,
    finite,
    full_name,
    non_negative,
    one_of,
    one_of_or_code,
    positive,
)

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Tone:
    """A sinusoidal jitter, such as that of a reaction wheel or a cooler.

        angle about an axis = sqrt(2) rms cos(2 pi frequency t + phase + lead),   t = 0 mid-exposure

    frequency       hertz, of the sinusoid
    rms_x, _y, _z   radian, root mean square about each of the camera's axes
    phase           radian; None: random in each trial
    lead_y, lead_z  radian, phase of these axes ahead of x: -90 deg makes a circle
    """

    frequency: Annotated[float, Unit("Hz")]
    rms_x: Annotated[float, Unit("rad", "arcsec")] = 0.0
    rms_y: Annotated[float, Unit("rad", "arcsec")] = 0.0
    rms_z: Annotated[float, Unit("rad", "arcsec")] = 0.0
    phase: Annotated[float | None, Unit("rad", "deg")] = None
    lead_y: Annotated[float, Unit("rad", "deg")] = 0.0
    lead_z: Annotated[float, Unit("rad", "deg")] = 0.0

    def __post_init__(self) -> None:
        positive(frequency=self.frequency)
        non_negative(rms_x=self.rms_x, rms_y=self.rms_y, rms_z=self.rms_z)
        finite(lead_y=self.lead_y, lead_z=self.lead_z)
        if self.phase is not None:
            finite(phase=self.phase)

    @property
    def silent(self) -> bool:
        """Whether it has no amplitude."""
        return not (self.rms_x or self.rms_y or self.rms_z)


@dataclass(frozen=True)
class Broadband:
    """Random jitter about one axis, with a power spectral density (PSD) given as a table.

    Between its points the density is a power law (linear in logarithms), as vibration levels are
    specified; outside them it is zero. Its integral is the rms squared.

    axis       x, y or z, of the camera
    frequency  hertz, increasing
    density    radian^2 / hertz, one-sided
    """

    axis: str
    frequency: Annotated[tuple[float, ...], Unit("Hz")]
    density: Annotated[tuple[float, ...], Unit("rad2 / Hz", "arcsec2 / Hz")]

    def __post_init__(self) -> None:
        one_of(AXES, axis=self.axis)
        if len(self.frequency) != len(self.density) or len(self.frequency) < 2:
            raise Refused(
                "frequency and density must have the same length of two or more, got "
                f"{len(self.frequency)} and {len(self.density)}"
            )
        for f, s in zip(self.frequency, self.density, strict=True):
            positive(frequency=f, density=s)
        if any(low >= high for low, high in pairwise(self.frequency)):
            raise Refused(f"frequency must increase, got {self.frequency}")


@dataclass(frozen=True)
class Motion:
    """How the camera turns in an exposure, about its own axes.

    rate_x, rate_y  radian / second, about the axes along the columns and rows: they smear stars
                    along y and x
    rate_z          radian / second, about the boresight: it smears stars around it
    tones           sinusoidal jitter; one without amplitude does not change the draws of the others
    broadband       random jitter, at most one spectrum for each axis
    jitter          code of one's own that draws lines of jitter in each trial, see
                    docs/extensions.md
    """

    rate_x: Annotated[float, Unit("rad/s", "deg/s")] = 0.0
    rate_y: Annotated[float, Unit("rad/s", "deg/s")] = 0.0
    rate_z: Annotated[float, Unit("rad/s", "deg/s")] = 0.0
    tones: tuple[Tone, ...] = ()
    broadband: tuple[Broadband, ...] = ()
    jitter: tuple[str, ...] = code_field("jitters", ())

    def __post_init__(self) -> None:
        finite(rate_x=self.rate_x, rate_y=self.rate_y, rate_z=self.rate_z)
        names = tuple(full_name("jitters", (), one) for one in self.jitter)
        object.__setattr__(self, "jitter", names)
        for one in names:
            one_of_or_code((), jitter=one)
        axes = [one.axis for one in self.broadband]
        if len(set(axes)) < len(axes):
            raise Refused(
                f"broadband must have at most one spectrum for each axis, got {', '.join(axes)}"
            )

    @property
    def rate(self) -> float:
        """Radian / second, length of the rate vector."""
        return math.hypot(self.rate_x, self.rate_y, self.rate_z)

    @property
    def drawn(self) -> bool:
        """Whether each trial has its own random motion."""
        return bool(self.broadband or self.jitter) or any(
            tone.phase is None and not tone.silent for tone in self.tones
        )
