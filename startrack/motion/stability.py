"""Drift and blur: of a path that was drawn, and what to expect of a motion."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, LineOfSight, positive
from startrack.motion.parameters import AXES, Motion
from startrack.motion.quadrature import joined, points
from startrack.motion.realisation import MotionRealisation, bands, realise_motion

FEWEST_POINTS, POINTS_PER_CYCLE = 32, 8  # of a mean square, whose waves are twice as fast


class Stability(NamedTuple):
    """How a path drifts and blurs; rotation vectors (3,) in radian, in camera axes.

    start  at the start of the exposure, against its middle
    end    at its end, against its middle
    mean   over the exposure, against its middle: what a tracker can know at best; the mean
           performance error (MPE) of ECSS-E-ST-60-10C, if the middle is what it is asked for
    rms    about that mean: the blur; the relative performance error (RPE)
    """

    start: Floats
    end: Floats
    mean: Floats
    rms: Floats


def stability(path: LineOfSight) -> Stability:
    """Drift and blur of one path, which starts and ends with the exposure as those of `shake`.

    Accuracy  numerical: a path has the points that its image needs: 1e-8 of an rms of 0.1 pixel,
              but 5 % of one of 1e-3. `blur` knows no such bound.
    """
    mean = path.weight @ path.rotation
    rms = np.sqrt(path.weight @ (path.rotation - mean) ** 2)
    return Stability(path.rotation[0], path.rotation[-1], mean, rms)


def blur(motion: Motion, exposure: float) -> Floats:
    """The blur to expect: rms about the mean of an exposure, over all trials.

        blur^2 = steady part + Int S(f) [1 - sinc(f T)^2] df,   sinc(a) = sin(pi a) / (pi a)

    Below 1 / T a spectrum acts as drift, above it as blur.
    Source: Lucke, Sirlin and San Martin (1992), J. Astronautical Sciences 40, 557.

    exposure  second, T
    Returns   (3,) radian, about the camera's axes
    Accuracy  numerical: 1e-6 of the blur.
    """
    positive(exposure=exposure)
    given = tuple(tone for tone in motion.tones if tone.phase is not None)
    square = _steady(realise_motion(replace(motion, tones=given, broadband=()), exposure), exposure)
    for tone in motion.tones:
        if tone.phase is None:
            rms = np.array([tone.rms_x, tone.rms_y, tone.rms_z])
            square += rms**2 * _blurred(tone.frequency * exposure)
    node, weight = np.polynomial.legendre.leggauss(6)
    for spectrum in motion.broadband:
        table = bands(spectrum)
        # Equal fractions of a band's power, so that the density is in the places, not the weights.
        seen = _blurred(table.place((node[:, None] + 1) / 2) * exposure)
        square[AXES.index(spectrum.axis)] += weight / 2 @ seen @ table.power
    return np.sqrt(square)


def jitter_rms(motion: Motion, exposure: float) -> Floats:
    """How far the mean of an exposure lies from its middle, by jitter: rms over all trials.

        wander^2 = Int S(f) [1 - sinc(f T)]^2 df

    exposure  second, T
    Returns   (3,) radian, about the camera's axes; a tone of given phase counts as if it had none
    Accuracy  numerical: 1e-6.
    """
    square = np.zeros(3)
    for tone in motion.tones:
        rms = np.array([tone.rms_x, tone.rms_y, tone.rms_z])
        square += rms**2 * (1 - np.sinc(tone.frequency * exposure)) ** 2
    node, weight = np.polynomial.legendre.leggauss(6)
    for spectrum in motion.broadband:
        table = bands(spectrum)
        off = (1 - np.sinc(table.place((node[:, None] + 1) / 2) * exposure)) ** 2
        square[AXES.index(spectrum.axis)] += weight / 2 @ off @ table.power
    return np.sqrt(square)


def _steady(motion: MotionRealisation, exposure: float) -> Floats:
    """(3,) radian^2, the mean square of a known motion about its mean, however small it is."""
    cycles = motion.frequency.max(initial=0.0) * exposure
    start, step, weight = points(math.ceil(FEWEST_POINTS + POINTS_PER_CYCLE * cycles))
    angle = joined(motion.over(exposure * start, exposure * step))
    return weight @ (angle - weight @ angle) ** 2


def _blurred(cycles: Floats | float) -> Floats:
    """Share of a line's power that blurs an exposure of so many cycles."""
    x = np.square(np.pi * np.asarray(cycles, float))
    # The series, where the difference would lose its digits.
    return np.where(x < 1e-3, x / 3 * (1 - x * (2 / 15 - x / 105)), 1 - np.sinc(cycles) ** 2)
