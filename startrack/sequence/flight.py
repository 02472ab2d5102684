"""Profile and jitter -> the true motion of each frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.case import Instrument
from startrack.motion import Turn, turn
from startrack.sequence.parameters import Sequence
from startrack.sequence.profile import attitudes, rates
from startrack.streams import Streams

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Flight:
    """What the camera truly does.

    time      (m,) second, the middle of each exposure, of its middle row
    attitude  (m,) icrs_to_camera then
    turns     (m,) how the camera moves about these times
    """

    time: Floats
    attitude: Rotation
    turns: tuple[Turn, ...]


def flight(instrument: Instrument, sequence: Sequence, start: Rotation, streams: Streams) -> Flight:
    """Draw the jitter once for the whole sequence, so that it goes on from frame to frame.

    start   attitude at time 0, before the jitter
    Errors  ValueError where the frames come faster than their exposures allow, or the legs are
            shorter than one frame.
            model: a frame in which a leg ends moves at the rate of its middle to its end; the
            turns of slew and jitter in one exposure are added, as in `Turn.at`. Broadband jitter
            has the covariance of its spectrum at all times, by one line a band for the whole
            sequence: within one long sequence a band's power does not come and go.
    """
    time = _times(instrument, sequence)
    jitter = turn(
        replace(instrument.motion, rate_x=0.0, rate_y=0.0, rate_z=0.0), sequence.duration, streams
    )
    attitude = Rotation.from_rotvec(jitter.at(time)) * attitudes(sequence.legs, start, time)
    turns = tuple(
        replace(jitter.later(float(at)), rate=rate)
        for at, rate in zip(time, rates(sequence.legs, time), strict=True)
    )
    return Flight(time, attitude, turns)


def _times(instrument: Instrument, sequence: Sequence) -> Floats:
    detector = instrument.detector
    period = 1 / detector.update_rate if sequence.period is None else sequence.period
    if period < detector.exposure:
        raise ValueError(
            f"period must be at least the exposure of {detector.exposure:g} s, got {period:g} s"
        )
    sweep = detector.exposure + detector.row_delay * (detector.rows - 1)
    frames = math.floor((sequence.duration - sweep) / period * (1 + 1e-12)) + 1
    if frames < 1:
        raise ValueError(
            f"legs must last at least one frame of {sweep:g} s, got {sequence.duration:g} s"
        )
    return np.asarray(sweep / 2 + period * np.arange(frames), float)
