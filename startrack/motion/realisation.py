"""Motion -> MotionRealisation: rotation of the camera in one trial, at any time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import gammaincinv

from startrack.core import POINTS, Floats, Streams, call_code, printed, returned
from startrack.motion.parameters import AXES, Broadband, Motion, Tone

GROUP = "jitters"

# Frequencies (k,) hertz and complex amplitudes (k, 3) radian.
Lines = tuple[Floats, NDArray[np.complex128]]


@dataclass(frozen=True, eq=False)
class JitterInput:
    """Inputs of user code that draws jitter.

    exposure   second
    generator  random numbers of the trial for this jitter alone

    The function returns (k, 7): frequency in hertz, then the amplitudes of the cosines about x, y
    and z, then of the sines about x, y and z, in radian; time zero is the middle of the exposure
    """

    exposure: float
    generator: np.random.Generator


def lines_by_code(name: str, exposure: float, generator: np.random.Generator) -> Lines:
    """Frequencies (k,) hertz and complex amplitudes (k, 3) radian from a design's user code.

    Raises  ValueError if the function raises an error or returns an invalid value.
    """
    answer = call_code(GROUP, name, JitterInput(exposure, generator))
    lines = returned(GROUP, name, answer, (-1, 7))
    if (lines[:, 0] < 0).any():
        raise ValueError(f"{POINTS[GROUP]} {name} must return no negative frequency")
    return lines[:, 0], lines[:, 1:4] - 1j * lines[:, 4:]


BANDS_PER_OCTAVE = 8  # chosen by hand: a sum of tens of lines is nearly normal


@dataclass(frozen=True, eq=False)
class Bands:
    """A spectrum in narrow bands; one line represents each band in an exposure.

    low       (k,) hertz, lower end of each band
    octave    (k,) 1, natural logarithm of the ratio of the band's ends
    exponent  (k,) 1, exponent of the power law frequency * density
    power     (k,) radian^2, integral of the density over the band
    """

    low: Floats
    octave: Floats
    exponent: Floats
    power: Floats

    @property
    def width(self) -> Floats:
        """Width (k,) of each band, hertz."""
        return self.low * np.expm1(self.octave)

    def frequency_at(self, fraction: Floats) -> Floats:
        """Frequency (..., k), hertz, below which each band has a fraction (..., k) of its power.

        It is the inverse of the cumulative power: uniform random fractions give frequencies in
        proportion to the density.
        """
        flat = np.abs(self.exponent) * self.octave < 1e-9
        slope = np.where(flat, 1.0, self.exponent)
        steep = np.log1p(fraction * np.expm1(slope * self.octave)) / slope
        return self.low * np.exp(np.where(flat, fraction * self.octave, steep))


@lru_cache(maxsize=64)
def bands(spectrum: Broadband) -> Bands:
    """Divide a spectrum at the points of its table and at eight frequencies in each octave.

    Accuracy  numerical: the powers add up to the integral of the table to 1e-13.
    """
    f, s = np.log(spectrum.frequency), np.log(spectrum.density)
    count = np.maximum(np.ceil(np.diff(f) / np.log(2) * BANDS_PER_OCTAVE), 1).astype(int)
    low = np.concatenate(
        [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(f[:-1], f[1:], count, strict=True)]
    )
    octave = np.diff(np.append(low, f[-1]))
    exponent = np.repeat(np.diff(s) / np.diff(f) + 1, count)
    start = np.exp(np.interp(low, f, s) + low)
    growth = exponent * octave
    # (e^u - 1) / u without the singularity at 0, where the density falls as 1 / f.
    mean = np.where(np.abs(growth) < 1e-9, 1.0, np.expm1(growth) / np.where(growth, growth, 1.0))
    return Bands(np.exp(low), octave, exponent, start * octave * mean)


@printed
@dataclass(frozen=True, eq=False)
class MotionRealisation:
    """Rotation of the camera about its axes: a constant rate and a sum of lines.

        angle(t) = rate t + sum_k cosine_k [cos(2 pi f_k t) - 1] + sine_k sin(2 pi f_k t)

    rate       (3,) radian / second
    frequency  (k,) hertz
    cosine     (k, 3) radian
    sine       (k, 3) radian
    """

    rate: Floats
    frequency: Floats
    cosine: Floats
    sine: Floats

    def at(self, time: Floats) -> Floats:
        """Rotation vectors as in LineOfSight, at any times.

        time     (m,) second from the middle of the exposure
        Returns   (m, 3) radian; the sky turns against the camera, hence the minus sign
        Accuracy  model: the rotation vectors of slew and jitter are added, with an error of half
                  their product.
        """
        angle = np.multiply.outer(time, self.rate)
        if len(self.frequency):
            half = np.multiply.outer(time, np.pi * self.frequency)
            sine = np.sin(half)
            # cos - 1 and sin of the phase, without cancellation in cos - 1.
            angle += -2 * sine**2 @ self.cosine + 2 * sine * np.cos(half) @ self.sine
        return -angle

    def over(self, start: Floats, step: Floats) -> Floats:
        """As `at`, at the times start + step of all pairs; it computes p + j sines for each line.

        start    (p,) second
        step     (j,) second
        Returns  (p, j, 3) radian
        Accuracy  numerical: 1e-15 of the amplitudes.
        """
        first, second = (
            np.exp(2j * np.pi * np.multiply.outer(time, self.frequency)) for time in (start, step)
        )
        amplitude = self.cosine - 1j * self.sine
        # Axis by axis, because most lines rotate about one axis. einsum is used, because the last
        # digit of a matrix product depends on the number of threads.
        lines = []
        for axis, used in enumerate((amplitude != 0).T):
            a, b = first[:, used] * amplitude[used, axis], second[:, used].conj()
            real = [np.concatenate([phasor.real, phasor.imag], axis=1) for phasor in (a, b)]
            lines.append(np.einsum("pk,jk->pj", *real) - self.cosine[:, axis].sum())
        time = np.add.outer(start, step)
        return -(time[..., None] * self.rate + np.stack(lines, axis=-1))

    def mean(self, exposure: float) -> Floats:
        """Mean rotation vector (3,), as `at`, over an exposure (second) about time zero; exact."""
        drop = np.sinc(self.frequency * exposure) - 1
        return np.asarray(-drop @ self.cosine)

    def later(self, time: float) -> MotionRealisation:
        """The motion with the zeros of time and angle moved to `time` (second)."""
        line = (self.cosine - 1j * self.sine) * np.exp(2j * np.pi * time * self.frequency)[:, None]
        return MotionRealisation(self.rate, self.frequency, line.real.copy(), -line.imag)

    def seen_from(self, turn: Rotation) -> MotionRealisation:
        """The motion about the axes of another camera, to which `turn` rotates."""
        rate, cosine, sine = (turn.apply(part) for part in (self.rate, self.cosine, self.sine))
        return MotionRealisation(rate, self.frequency, cosine, sine)

    @property
    def tones(self) -> tuple[Tone, ...]:
        """The lines as tones of known phases, from which `realise_motion` makes the same motion."""
        line = self.cosine - 1j * self.sine
        phase, rms = np.angle(line), np.abs(line) / math.sqrt(2)
        return tuple(
            Tone(hertz, size[0], size[1], size[2], x, y - x, z - x)
            for hertz, size, (x, y, z) in zip(
                self.frequency.tolist(), rms.tolist(), phase.tolist(), strict=True
            )
        )

    @property
    def speed(self) -> Floats:
        """Rms rate (3,) about each axis, radian / second."""
        lines = (2 * np.pi * self.frequency[:, None]) ** 2 * (self.cosine**2 + self.sine**2) / 2
        return np.sqrt(self.rate**2 + lines.sum(axis=0))


def realise_motion(
    motion: Motion, exposure: float, streams: Streams | None = None, dither: Sequence[Tone] = ()
) -> MotionRealisation:
    """Draw the phases of the tones and the lines of the broadband jitter.

    exposure  second; determines the variation of a band's power between trials
    streams   random streams of the trial; needed only for a random motion
    dither    commanded tones in addition, without the factor of the jitter
    Raises    TypeError for a random motion without streams.
    Accuracy  model: the covariance of the sum is exact at all times; the distribution is nearly
              normal, as a sum over tens of bands.
    """
    factors = [motion.jitter_factor] * len(motion.tones) + [1.0] * len(dither)
    tones = enumerate(zip((*motion.tones, *dither), factors, strict=True))
    lines = [
        _scaled(factor, _tone(tone, f"tone {number}", streams))
        for number, (tone, factor) in tones
        if factor and not tone.silent
    ]
    if motion.jitter_factor:
        random = [_broadband(spectrum, exposure, streams) for spectrum in motion.broadband]
        random += [
            lines_by_code(name, exposure, _generator(streams, f"jitter {name}"))
            for name in motion.jitter
        ]
        lines += [_scaled(motion.jitter_factor, some) for some in random]
    frequency = np.concatenate([np.zeros(0), *(f for f, _ in lines)])
    amplitude = np.concatenate([np.zeros((0, 3), complex), *(a for _, a in lines)])
    return MotionRealisation(motion.rates, frequency, amplitude.real.copy(), -amplitude.imag)


def _scaled(factor: float, lines: Lines) -> Lines:
    frequency, amplitude = lines
    return frequency, factor * amplitude


def _tone(tone: Tone, cause: str, streams: Streams | None) -> Lines:
    """The frequency (1,) and the complex amplitude (1, 3) of a tone."""
    phase = tone.phase
    if phase is None:
        phase = 2 * math.pi * _generator(streams, cause).random()
    rms = np.array([tone.rms_x, tone.rms_y, tone.rms_z])
    lead = np.array([0.0, tone.lead_y, tone.lead_z])
    amplitude = math.sqrt(2) * rms * np.exp(1j * (phase + lead))
    return np.array([tone.frequency]), amplitude[None, :]


def _broadband(spectrum: Broadband, exposure: float, streams: Streams | None) -> Lines:
    """One line for each band: (k,) hertz, (k, 3) radian.

    The frequency is drawn in proportion to the density, so that the covariance is exact for any
    width of the band. A process of bandwidth B has B T independent lines in a time T. So its power
    has a gamma distribution of shape B T, at least 1; for shape 1 the amplitude is normal.

    Source: Shinozuka and Deodatis (1991), Applied Mechanics Reviews 44, 191, for the sum of lines.
    """
    table = bands(spectrum)
    fraction, angle, chance = _generator(streams, f"broadband {spectrum.axis}").random(
        (3, len(table.low))
    )
    shape = np.maximum(table.width * exposure, 1.0)
    power = table.power * gammaincinv(shape, chance) / shape
    amplitude = np.zeros((len(fraction), 3), complex)
    amplitude[:, AXES.index(spectrum.axis)] = np.sqrt(2 * power) * np.exp(2j * np.pi * angle)
    return table.frequency_at(fraction), amplitude


def _generator(streams: Streams | None, cause: str) -> np.random.Generator:
    if streams is None:
        raise TypeError(f"streams must be given where {cause} is drawn, got None")
    return streams(cause)
