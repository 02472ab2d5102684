"""Signal chain of a pixel: its digital number from its electrons and its read noise."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from startrack.core import Floats, kernel
from startrack.detector.parameters import Detector

Image = NDArray[np.uint16] | NDArray[np.uint32]


class Law(NamedTuple):
    """From electrons to a digital number, without the random draws.

        held   = min(electrons, full_well)
        signal = held (1 - nonlinearity held / full_well)
        x      = (signal + read noise) gain + offset
        y      = clip(x / largest, 0, 1)
        number = clip(floor(x + 4 adc_inl y (1 - y) + 1/2), 0, largest)

    Source: Krutz et al. (2011), eq. (5); EMVA 1288 release 4.0, section 2.2. The non-linearity is
    the first term of a power series; the parabola is the most common form of an integral
    non-linearity (INL).

    noise         electron rms
    full_well     electron
    nonlinearity  1, fraction by which the signal of a full pixel is too small
    gain          digital number / electron
    offset        digital number
    adc_inl       digital number, INL of the converter at half scale
    largest       digital number
    """

    noise: float
    full_well: float
    nonlinearity: float
    gain: float
    offset: float
    adc_inl: float
    largest: float


COUNT = Law(0.0, math.inf, 0.0, 1.0, 0.0, 0.0, math.inf)  # numbers are electrons


def law_of(detector: Detector) -> Law:
    """The law of a detector's pixels."""
    largest = 2**detector.bits - 1
    return Law(
        math.hypot(detector.read_noise, detector.reset_noise),
        detector.full_well,
        detector.nonlinearity,
        detector.gain * largest / detector.full_well,
        float(detector.offset),
        detector.adc_inl,
        float(largest),
    )


@register_jitable(error_model="numpy")
def nonlinear_signal(charge, full_well, nonlinearity):  # type: ignore[no-untyped-def]
    """Signal of a charge, electron; for numbers in kernels and for arrays."""
    return charge * (1.0 - nonlinearity * charge / full_well)


@register_jitable(error_model="numpy")
def with_adc_inl(x, y, adc_inl):  # type: ignore[no-untyped-def]
    """Output of the converter before rounding; y is x over its largest number. Use as above."""
    return x + 4.0 * adc_inl * y * (1.0 - y)


@kernel
def signal(electrons, full_well, nonlinearity):  # type: ignore[no-untyped-def]
    """Signal of the electrons that a pixel caught, of which it holds a full well at most."""
    return nonlinear_signal(min(electrons, full_well), full_well, nonlinearity)


@kernel
def number(level, gain, offset, adc_inl, largest):  # type: ignore[no-untyped-def]
    """The digital number of a signal with its noise."""
    x = level * gain + offset
    y = min(max(x / largest, 0.0), 1.0)
    return min(max(math.floor(with_adc_inl(x, y, adc_inl) + 0.5), 0.0), largest)


def converted(level: Floats, law: Law) -> Floats:
    """Digital numbers of signals that contain their noise, element by element."""
    level = np.asarray(level, dtype=float)
    flat = _numbers(level.ravel(), law.gain, law.offset, law.adc_inl, law.largest)
    return flat.reshape(level.shape)


@kernel
def _numbers(level, gain, offset, adc_inl, largest):  # type: ignore[no-untyped-def]
    numbers = np.empty(len(level))
    for i in range(len(level)):
        numbers[i] = number(level[i], gain, offset, adc_inl, largest)
    return numbers


def mean_numbers(electrons: Floats, law: Law) -> Floats:
    """Digital numbers of expected electrons without noise and rounding, element by element."""
    held = np.minimum(electrons, law.full_well)
    x = nonlinear_signal(held, law.full_well, law.nonlinearity) * law.gain + law.offset
    y = np.clip(x / law.largest, 0, 1)
    return np.clip(with_adc_inl(x, y, law.adc_inl), 0, law.largest)


def blank(shape: tuple[int, ...], law: Law) -> Image:
    """An image without content, of the type of its numbers."""
    return np.empty(shape, kind_of(law))


def kind_of(law: Law) -> np.dtype[Any]:
    """The smaller of the two types that hold the numbers."""
    return np.dtype(np.uint16 if law.largest < 2**16 else np.uint32)


def upper_edge(law: Law, numbers: Floats) -> Floats:
    """Signal at which each digital number gives way to the next, electron; inverse of `number`."""
    wanted = numbers + 0.5
    inside = (wanted > 0) & (wanted < law.largest)
    parabola = np.where(inside, 4 * law.adc_inl, 0.0)
    # The root of x (1 + b) - b x^2 / largest = wanted, in the form that loses no digits.
    middle = 1 + parabola / law.largest
    root = np.sqrt(middle**2 - 4 * parabola / law.largest**2 * wanted)
    return (2 * wanted / (middle + root) - law.offset) / law.gain
