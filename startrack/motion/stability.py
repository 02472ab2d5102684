"""Drift and blur: of one line of sight, and their expectation over all trials."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, LineOfSight, positive
from startrack.motion.line_of_sight import join_panels, lobatto_points
from startrack.motion.parameters import AXES, Motion
from startrack.motion.realisation import MotionRealisation, bands, realise_motion

FEWEST_POINTS, POINTS_PER_CYCLE = 32, 8  # of a mean square, whose frequencies are doubled


class Stability(NamedTuple):
    """Drift and blur in an exposure; rotation vectors (3,) in radian, in camera axes.

    start  at the start of the exposure, relative to its middle
    end    at its end, relative to its middle
    mean   over the exposure, relative to its middle: the smallest possible error of a tracker; the
           mean performance error (MPE) of ECSS-E-ST-60-10C, if the attitude refers to the middle
    rms    about that mean: the blur; the relative performance error (RPE)
    """

    start: Floats
    end: Floats
    mean: Floats
    rms: Floats


def stability(path: LineOfSight) -> Stability:
    """Drift and blur of one line of sight, from the start to the end of the exposure.

    path      as `sample_jitter` and `slew` give it
    Accuracy  numerical: it has only the points that the image needs: 1e-8 of an rms of 0.1 pixel,
              but 5 % of one of 1e-3. `blur` has no such limit.
    """
    mean = path.weight @ path.rotation
    rms = np.sqrt(path.weight @ (path.rotation - mean) ** 2)
    return Stability(path.rotation[0], path.rotation[-1], mean, rms)


def blur(motion: Motion, exposure: float) -> Floats:
    """Expected blur: rms about the mean of an exposure, over all trials; `jitter` is left out.

        blur^2 = deterministic part + Int S(f) [1 - sinc(f T)^2] df,   sinc(a) = sin(pi a) / (pi a)

    Below 1 / T a spectrum acts as drift, above it as blur.
    Source: Lucke, Sirlin and San Martin (1992), J. Astronautical Sciences 40, 557.

    exposure  second, T
    Returns   (3,) radian, about the camera's axes
    Accuracy  numerical: 1e-6 of the blur.
    """
    positive(exposure=exposure)
    given = tuple(tone for tone in motion.tones if tone.phase is not None)
    certain = replace(motion, tones=given, broadband=(), jitter=())
    square = _deterministic_square(realise_motion(certain, exposure), exposure)
    for tone in motion.tones:
        if tone.phase is None:
            rms = np.array([tone.rms_x, tone.rms_y, tone.rms_z])
            square += rms**2 * _blurred_fraction(tone.frequency * exposure)
    node, weight = np.polynomial.legendre.leggauss(6)
    for spectrum in motion.broadband:
        table = bands(spectrum)
        # Equal fractions of the power of a band, so that the frequencies contain the density.
        seen = _blurred_fraction(table.frequency_at((node[:, None] + 1) / 2) * exposure)
        square[AXES.index(spectrum.axis)] += weight / 2 @ seen @ table.power
    return np.sqrt(square)


def jitter_rms(motion: Motion, exposure: float) -> Floats:
    """Distance between the mean of an exposure and its middle by jitter: rms over all trials.

    `motion.jitter` is left out.

        jitter_rms^2 = Int S(f) [1 - sinc(f T)]^2 df

    exposure  second, T
    Returns   (3,) radian, about the camera's axes; the phase of a tone is taken as random
    Accuracy  numerical: 1e-6.
    """
    square = np.zeros(3)
    for tone in motion.tones:
        rms = np.array([tone.rms_x, tone.rms_y, tone.rms_z])
        square += rms**2 * (1 - np.sinc(tone.frequency * exposure)) ** 2
    node, weight = np.polynomial.legendre.leggauss(6)
    for spectrum in motion.broadband:
        table = bands(spectrum)
        off = (1 - np.sinc(table.frequency_at((node[:, None] + 1) / 2) * exposure)) ** 2
        square[AXES.index(spectrum.axis)] += weight / 2 @ off @ table.power
    return np.sqrt(square)


def _deterministic_square(motion: MotionRealisation, exposure: float) -> Floats:
    """(3,) radian^2, the mean square of a motion about its mean."""
    cycles = motion.frequency.max(initial=0.0) * exposure
    start, step, weight = lobatto_points(math.ceil(FEWEST_POINTS + POINTS_PER_CYCLE * cycles))
    angle = join_panels(motion.over(exposure * start, exposure * step))
    return weight @ (angle - weight @ angle) ** 2


def _blurred_fraction(cycles: Floats | float) -> Floats:
    """Fraction of the power of a line that blurs an exposure of this many cycles."""
    x = np.square(np.pi * np.asarray(cycles, float))
    # The series, where the difference would lose digits.
    return np.where(x < 1e-3, x / 3 * (1 - x * (2 / 15 - x / 105)), 1 - np.sinc(cycles) ** 2)
