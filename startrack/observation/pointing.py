"""Attitude of a trial, the camera's motion about it, and the attitude the tracker must report."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Floats, LineOfSight, Streams
from startrack.design import Case, Instrument
from startrack.detector import MotionFunction
from startrack.motion import MotionRealisation, jitter_rms, realise_motion, sample_jitter, trace


def random_attitude(streams: Streams) -> Rotation:
    """An attitude icrs_to_camera, uniform over all rotations."""
    return Rotation.from_quat(_quaternion(streams))


def random_attitudes(seed: int, numbers: Sequence[int]) -> Rotation:
    """`random_attitude` of some trials of a seed."""
    return Rotation.from_quat([_quaternion(Streams(seed, number)) for number in numbers])


def rotations_from_cube(cube: Floats) -> Rotation:
    """Rotations from points (n, 3) in the unit cube; uniform points give uniform rotations.

    Source: Shoemake (1992), Uniform random rotations, Graphics Gems III, 124.
    """
    radius, p, q = np.sqrt(cube[:, 0]), 2 * np.pi * cube[:, 1], 2 * np.pi * cube[:, 2]
    rest = np.sqrt(1 - cube[:, 0])
    x, y, z, w = rest * np.sin(p), rest * np.cos(p), radius * np.sin(q), radius * np.cos(q)
    return Rotation.from_quat(np.column_stack([x, y, z, w]))


def _quaternion(streams: Streams) -> Floats:
    return streams("attitude").standard_normal(4)


def line_of_sight(
    instrument: Instrument, streams: Streams, turn: MotionRealisation | None = None
) -> LineOfSight:
    """The path of the line of sight in the exposure of one trial.

    turn  motion of the camera relative to the middle of the exposure; None: it is drawn
    """
    camera, exposure = instrument.camera, instrument.detector.exposure
    pixel, half = 1 / camera.focal_length_px, camera.half_diagonal
    if turn:
        return trace(turn, exposure, pixel, half)
    return sample_jitter(instrument.motion, exposure, pixel, streams, half)


def motion_function(
    instrument: Instrument, streams: Streams, turn: MotionRealisation | None = None
) -> MotionFunction | None:
    """The motion of `line_of_sight` at any time; None except for a rolling shutter."""
    detector = instrument.detector
    if not detector.row_delay:
        return None
    return (turn or realise_motion(instrument.motion, detector.exposure, streams)).over


def motion_before(
    instrument: Instrument,
    path: LineOfSight,
    streams: Streams,
    turn: MotionRealisation | None = None,
) -> tuple[LineOfSight, MotionFunction]:
    """The line of sight in the exposure of the previous frame, and its motion at any time."""
    detector = instrument.detector
    motion = turn or realise_motion(instrument.motion, detector.exposure, streams)
    late = 1 / detector.update_rate
    earlier = replace(path, rotation=motion.at(path.time - late))
    return earlier, lambda start, step: motion.over(start - late, step)


def mean_attitude(instrument: Instrument, icrs_to_camera: Rotation, streams: Streams) -> Rotation:
    """The mean attitude over a trial's exposure, from the attitude at the middle of the exposure.

    For a slew at a constant rate, both attitudes are equal.
    """
    motion, exposure = instrument.motion, instrument.detector.exposure
    if not motion.jitters:
        return icrs_to_camera
    turn = realise_motion(motion, exposure, streams).mean(exposure)
    return Rotation.from_rotvec(turn) * icrs_to_camera


def reference_attitude(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Rotation:
    """The attitude icrs_to_camera that the tracker must report to be free of error.

    The time tag may be late, and the mounting may differ from the believed mounting. Therefore the
    reference is the spacecraft's attitude at the time tag, or its mean over the exposure, converted
    to camera axes by the believed mounting.
    """
    truth = icrs_to_camera
    if case.time_tag_error:
        path = realise_motion(case.instrument.motion, case.instrument.detector.exposure, streams)
        truth = Rotation.from_rotvec(path.at(np.array([case.time_tag_error]))[0]) * truth
    if case.tracker.reference == "mean":
        truth = mean_attitude(case.instrument, truth, streams)
    return in_believed_axes(case, truth, streams)


def in_believed_axes(case: Case, attitude: Rotation, streams: Streams) -> Rotation:
    """One attitude or several, in camera axes by the mounting that the tracker assumes."""
    mounting, believed = case.instrument.mounting, case.believed_mounting
    if mounting == believed:
        return attitude
    phase = 2 * math.pi * streams("thermo-elastic").random() if mounting.swings else 0.0
    return believed.camera_to_body().inv() * mounting.camera_to_body(phase) * attitude


def exposure_jitter(case: Case) -> Floats:
    """Radian^2 (3,) about the camera's axes: mean attitude of an exposure minus the reference.

    Zero if the reference is the mean, and for a detector that scans. Jitter by user code is not
    counted.
    """
    instrument = case.instrument
    if case.tracker.reference == "mean" or instrument.detector.scan:
        return np.zeros(3)
    return np.asarray(jitter_rms(instrument.motion, instrument.detector.exposure) ** 2)


def platform_jitter(case: Case) -> Floats:
    """`exposure_jitter` of a platform, which all heads share; zero if the jitter is of one head."""
    return np.zeros(3) if case.instrument.motion.jitter_of != "platform" else exposure_jitter(case)
