"""Profile and jitter -> true motion of each frame, and output of the gyroscope."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Ints, Refused, Streams, Unit, printed
from startrack.design import Instrument
from startrack.motion import MotionRealisation, realise_motion
from startrack.sequence.parameters import Gyro, Leg, Sequence


def attitudes(legs: tuple[Leg, ...], start: Rotation, time: Floats) -> Rotation:
    """The attitude icrs_to_camera of the profile, without jitter.

    A camera that turns at the rate w sees the sky turn the opposite way: A(t + s) = exp(-[w]x s)
    A(t).

    start  attitude at time 0
    time   (m,) second, from 0 on; after the last leg its rate continues
    Accuracy  numerical: only rounding, because the rotation of a leg is a closed form.
    """
    begin, rate = _begins(legs), _rates(legs)
    corner = [start]
    for leg, spin in zip(legs, rate, strict=True):
        corner.append(Rotation.from_rotvec(-spin * leg.duration) * corner[-1])
    leg_of = _leg_of(begin, time)
    since = (time - begin[leg_of])[:, None]
    return Rotation.from_rotvec(-rate[leg_of] * since) * Rotation.concatenate(corner)[leg_of]


def rates(legs: tuple[Leg, ...], time: Floats) -> Floats:
    """The rate (m, 3) of the camera about its own axes, radian / second."""
    return _rates(legs)[_leg_of(_begins(legs), time)]


def _begins(legs: tuple[Leg, ...]) -> Floats:
    return np.concatenate([[0.0], np.cumsum([leg.duration for leg in legs])[:-1]])


def _rates(legs: tuple[Leg, ...]) -> Floats:
    return np.array([[leg.rate_x, leg.rate_y, leg.rate_z] for leg in legs])


def _leg_of(begin: Floats, time: Floats) -> Ints:
    return np.maximum(np.searchsorted(begin, time, side="right") - 1, 0)


@printed
@dataclass(frozen=True, eq=False)
class SequenceFlight:
    """True motion of the camera.

    time      (m,) second, the middle of each exposure, of its middle row
    attitude  (m,) icrs_to_camera then
    turns     (m,) motion of the camera around these times
    """

    time: Annotated[Floats, Unit("s")]
    attitude: Rotation
    turns: tuple[MotionRealisation, ...]

    def seen_from(self, turn: Rotation) -> SequenceFlight:
        """The motion of another camera on the same bench, to whose axes `turn` rotates."""
        turns = tuple(motion.seen_from(turn) for motion in self.turns)
        return SequenceFlight(self.time, turn * self.attitude, turns)


def flight(
    instrument: Instrument, sequence: Sequence, start: Rotation, streams: Streams
) -> SequenceFlight:
    """Draw the jitter once for the whole sequence, so that it continues from frame to frame.

    start   attitude at time 0, before the jitter
    Raises    ValueError if the period is shorter than the exposures allow, or the legs are shorter
              than one frame.
    Accuracy  model: a frame in which a leg ends keeps the rate of its middle until its end; the
              rotations of slew and jitter in one exposure are added, as in
              `MotionRealisation.at`. Broadband jitter has the covariance of its spectrum at all
              times, by one line a band for the whole sequence: the power of a band does not vary
              within a long sequence.
    """
    time = _times(instrument, sequence)
    moves = replace(instrument.motion, rate_x=0.0, rate_y=0.0, rate_z=0.0)
    jitter = realise_motion(moves, sequence.duration, streams, sequence.dither)
    attitude = Rotation.from_rotvec(jitter.at(time)) * attitudes(sequence.legs, start, time)
    turns = tuple(
        replace(jitter.later(float(at)), rate=rate)
        for at, rate in zip(time, rates(sequence.legs, time), strict=True)
    )
    return SequenceFlight(time, attitude, turns)


def _times(instrument: Instrument, sequence: Sequence) -> Floats:
    detector = instrument.detector
    period = 1 / detector.update_rate if sequence.period is None else sequence.period
    if period < detector.exposure:
        raise Refused(
            f"period must be at least the exposure of {detector.exposure:g} s, got {period:g} s"
        )
    sweep = detector.exposure + detector.row_delay * (detector.rows - 1)
    frames = math.floor((sequence.duration - sweep) / period * (1 + 1e-12)) + 1
    if frames < 1:
        raise Refused(
            f"legs must last at least one frame of {sweep:g} s, got {sequence.duration:g} s"
        )
    return np.asarray(sweep / 2 + period * np.arange(frames), float)


def gyro_rates(flight: SequenceFlight, gyro: Gyro, streams: Streams) -> Floats:
    """Mean rates from each frame to the next, as the gyroscope measures them.

    White noise of the rate, and a bias with a random walk. The mean of the walk over a step and its
    end are drawn jointly, so that the result is exact for any step.

    Source: Farrenkopf (1978), J. Guidance and Control 1(4), 282.

    Returns  (m - 1, 3) radian / second, in the gyroscope's axes
    Accuracy  model: its axes are at right angles, scale factors and quantisation are left out; the
              rate is taken as constant between two frames.
    """
    step, true = np.diff(flight.time)[:, None], _mean_rates(flight)
    if gyro.misalignment:
        angles = streams("misalignment of the gyroscope").standard_normal(3)
        true = Rotation.from_rotvec(gyro.misalignment * angles).apply(true)
    rng = streams("gyroscope")
    begin = gyro.bias * rng.standard_normal(3)
    white, walk, within = rng.standard_normal((3, len(step), 3))
    change = gyro.rate_random_walk * np.sqrt(step) * walk
    bias = begin + np.cumsum(change, axis=0) - change / 2
    bias += gyro.rate_random_walk * np.sqrt(step / 12) * within
    return true + bias + gyro.angle_random_walk / np.sqrt(step) * white


def exposure_rates(flight: SequenceFlight, shown: Floats) -> Floats:
    """Rates (m, 3) in the exposures, with the errors of a gyroscope that showed mean rates.

    It is the slew's rate plus the gyroscope's error of the step before; in the first exposure, of
    the step after.

    shown  (m - 1, 3) radian / second, as `gyro_rates` gives them
    """
    error = shown - _mean_rates(flight)
    slew = np.array([turn.rate for turn in flight.turns])
    return np.asarray(slew + np.concatenate([error[:1], error]) if len(error) else slew)


def _mean_rates(flight: SequenceFlight) -> Floats:
    """True mean rates from each frame to the next, (m - 1, 3) radian / second."""
    step = np.diff(flight.time)[:, None]
    turned = flight.attitude[1:] * flight.attitude[:-1].inv()
    return np.asarray(-turned.as_rotvec() / step)
