"""Case and attitude -> the image of a line detector, and its spots as those of a matrix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Frame, Light, Spots, Streams
from startrack.design import Case
from startrack.detector import Detector, Line, Scan, scan
from startrack.motion import Motion, realise_motion
from startrack.trial.view import psf_of, throughput


def sweep(case: Case, light: Light, icrs_to_camera: Rotation, streams: Streams) -> Frame:
    """The image that the lines make, half of it before time zero and half after.

    icrs_to_camera  true attitude at time zero
    Raises          as `detector.scan`
    """
    instrument = case.instrument
    detector, lines = _lines(instrument.detector)
    motion = realise_motion(instrument.motion, duration(instrument.detector), streams)
    return scan(
        light,
        psf_of(instrument),
        icrs_to_camera,
        motion.at,
        replace(instrument.camera, rows=len(lines)),
        lines,
        instrument.detector.rows,
        detector,
        throughput(instrument),
        streams,
    )


def straighten(
    spots: Spots, scanned: Scan, exposure: float, motion: Motion, camera: Camera
) -> Spots:
    """The spots that a matrix would have at time zero.

    A star was on the line when its row of the image was exposed; from there it is rotated back
    with the rates that the tracker believes.

        time = (y - (rows - 1) / 2 + delay) exposure

    spots     on the image of the lines
    exposure  second, of a line
    motion    as the tracker believes it; its rates count
    camera    of a matrix of as many rows as the image, as the tracker believes it
    Returns   the spots at other positions; the covariance along a line shrinks with its sampling
    Accuracy  model: all lines count as their mean, correct where image and charge move together;
              jitter is unknown to the tracker.
    """
    row, delay = scanned.middle
    time = (spots.y - (camera.rows - 1) / 2 + delay) * exposure
    x = spots.x / scanned.phases
    pixel = np.column_stack([x, np.full(len(x), row + (camera.rows - 1) / 2)])
    rates = np.array([motion.rate_x, motion.rate_y, motion.rate_z])
    # The sky turns against the camera; back to time zero it turns with it.
    back = Rotation.from_rotvec(np.multiply.outer(time, rates))
    place = camera.project(back.apply(camera.unproject(pixel))) if len(x) else pixel
    size = np.array([1 / scanned.phases, 1.0])
    covariance = spots.covariance * np.outer(size, size)
    return replace(spots, x=place[:, 0].copy(), y=place[:, 1].copy(), covariance=covariance)


def duration(detector: Detector) -> float:
    """Second, exposure of all rows of an image."""
    return detector.exposure * detector.rows


def _lines(detector: Detector) -> tuple[Detector, tuple[Line, ...]]:
    """The lines as a detector of as many rows, and their positions on it."""
    assert detector.scan
    lines = detector.scan.all_lines
    middle = (len(lines) - 1) / 2
    return (
        replace(detector, rows=len(lines), scan=None),
        tuple(replace(line, row=line.row + middle) for line in lines),
    )
