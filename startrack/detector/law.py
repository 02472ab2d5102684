"""Law: what the number of a pixel is, given the electrons that it caught and the read noise."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.detector.parameters import Detector

Image = NDArray[np.uint16] | NDArray[np.uint32]


class Law(NamedTuple):
    """From electrons to a digital number, without the random draws.

        held   = min(electrons, full_well)
        signal = held (1 - bend held / full_well)
        x      = (signal + read noise) gain + offset
        number = clip(floor(x + 4 bow y (1 - y) + 1/2), 0, largest),   y = clip(x / largest, 0, 1)

    Source: Krutz et al. (2011), eq. (5); EMVA 1288 release 4.0, section 2.2. The bend is the
    first term of any non-linearity; the bow is what an integral non-linearity mostly looks like.

    noise      electron rms
    full_well  electron
    bend       1, share by which the signal of a full pixel falls short
    gain       digital number / electron
    offset     digital number
    bow        digital number, at half scale
    largest    digital number
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


@njit(cache=True, error_model="numpy")
def signal(electrons, full_well, bend):  # type: ignore[no-untyped-def]
    """Electrons that the signal chain sees."""
    held = min(electrons, full_well)
    return held * (1.0 - bend * held / full_well)


@njit(cache=True, error_model="numpy")
def number(level, gain, offset, bow, largest):  # type: ignore[no-untyped-def]
    """The digital number of a signal with its noise."""
    x = level * gain + offset
    y = min(max(x / largest, 0.0), 1.0)
    return min(max(math.floor(x + 4.0 * bow * y * (1.0 - y) + 0.5), 0.0), largest)


def converted(level: Floats, law: Law) -> Floats:
    """The numbers of signals that hold their noise already, element by element."""
    level = np.asarray(level, dtype=float)
    flat = _numbers(level.ravel(), law.gain, law.offset, law.adc_inl, law.largest)
    return flat.reshape(level.shape)


@njit(cache=True, error_model="numpy")
def _numbers(level, gain, offset, bow, largest):  # type: ignore[no-untyped-def]
    numbers = np.empty(len(level))
    for i in range(len(level)):
        numbers[i] = number(level[i], gain, offset, bow, largest)
    return numbers


def mean_numbers(electrons: Floats, law: Law) -> Floats:
    """The numbers of expected electrons if nothing were noisy or rounded, element by element."""
    held = np.minimum(electrons, law.full_well)
    x = held * (1 - law.nonlinearity * held / law.full_well) * law.gain + law.offset
    y = np.clip(x / law.largest, 0, 1)
    return np.clip(x + 4 * law.adc_inl * y * (1 - y), 0, law.largest)


def blank(shape: tuple[int, ...], law: Law) -> Image:
    """An image to fill."""
    return np.empty(shape, kind_of(law))


def kind_of(law: Law) -> np.dtype[Any]:
    """The smaller type that holds the numbers."""
    return np.dtype(np.uint16 if law.largest < 2**16 else np.uint32)


def upper_edge(law: Law, numbers: Floats) -> Floats:
    """The signal at which a digital number gives way to the next, electron."""
    wanted = numbers + 0.5
    inside = (wanted > 0) & (wanted < law.largest)
    bow = np.where(inside, 4 * law.adc_inl, 0.0)
    # The root of x (1 + b) - b x^2 / largest = wanted, in the form that loses no digits.
    middle = 1 + bow / law.largest
    root = np.sqrt(middle**2 - 4 * bow / law.largest**2 * wanted)
    return (2 * wanted / (middle + root) - law.offset) / law.gain
