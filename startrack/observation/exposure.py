"""Case and attitude -> the exposure of its detector, a matrix or scanning lines."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Floats, Frame, Light, LineOfSight, Spots, Stars, Streams, deg
from startrack.design import Case, Instrument
from startrack.detector import Detector, Exposure, Line, LineExposure, Scan, expected, scan
from startrack.motion import Motion, MotionRealisation, realise_motion
from startrack.observation.images import images_of, psf_of
from startrack.observation.pointing import motion_before, motion_function
from startrack.observation.stars import light_of, throughput, throughput_of_colours

PACE = 0.5  # pixel, largest lead of stars over the charge in all stages of a TDI; chosen by hand


def sweep(case: Case, light: Light, icrs_to_camera: Rotation, streams: Streams) -> Frame:
    """The image of scanning lines; half of it is exposed before time zero and half after.

    icrs_to_camera  true attitude at time zero
    Raises          as `detector.scan`
    """
    instrument = case.instrument
    detector, lines = _lines(instrument.detector)
    motion = realise_motion(instrument.motion, duration(instrument.detector), streams)
    exposure = LineExposure(
        light=light,
        psf=psf_of(instrument),
        icrs_to_camera=icrs_to_camera,
        turn=motion.at,
        camera=replace(instrument.camera, rows=len(lines)),
        lines=lines,
        count=instrument.detector.rows,
        detector=detector,
        throughput=throughput(instrument),
    )
    return scan(exposure, streams)


def out_of_step(instrument: Instrument) -> str:
    """A sentence: lead of the stars over the charge of a TDI, and values that synchronise them.

    Empty if the lead is half a pixel or less over all stages, and for other detectors.
    """
    detector, camera = instrument.detector, instrument.camera
    if not detector.scan or detector.scan.kind != "tdi":
        return ""
    stages, direction = detector.scan.stages, -1 if detector.scan.upward else 1
    in_step = direction / (detector.exposure * camera.focal_length_px)  # radian / second
    pace = instrument.motion.rate_x / in_step
    ahead = (pace - 1) * (stages - 1)
    if abs(ahead) <= PACE:
        return ""
    exposure = f", or lines of {1e3 * detector.exposure / pace:.4g} ms," if pace > 0 else ""
    return (
        f"the stars run {ahead:+.3g} pixel ahead of the charge over {stages} stages: "
        f"instrument.motion.rate_x = {in_step / deg:.5g} deg / s{exposure} would keep them in step"
    )


def straighten(
    spots: Spots, scanned: Scan, exposure: float, motion: Motion, camera: Camera
) -> Spots:
    """The spots that a matrix would have at time zero.

    A star was on the line when its row of the image was exposed. Its direction is rotated back from
    this time to time zero, with the rates that the tracker assumes.

        time = (y - (rows - 1) / 2 + delay) exposure

    spots     spots on the image of the lines
    exposure  second, of a line
    motion    motion that the tracker assumes; only its rates count
    camera    camera that the tracker assumes, with a matrix of the same number of rows as the image
    Returns   the spots at other positions; the covariance along a line shrinks with its sampling
    Accuracy  model: all lines are represented by their mean, which is correct if image and charge
              move together; jitter is unknown to the tracker.
    """
    row, delay = scanned.middle
    time = (spots.y - (camera.rows - 1) / 2 + delay) * exposure
    x = spots.x / scanned.phases
    pixel = np.column_stack([x, np.full(len(x), row + (camera.rows - 1) / 2)])
    # The sky rotates against the camera; the correction back to time zero rotates with the camera.
    back = Rotation.from_rotvec(np.multiply.outer(time, motion.rates))
    place = camera.project(back.apply(camera.unproject(pixel))) if len(x) else pixel
    size = np.array([1 / scanned.phases, 1.0])
    covariance = spots.covariance * np.outer(size, size)
    return replace(spots, x=place[:, 0].copy(), y=place[:, 1].copy(), covariance=covariance)


def at_one_time(spots: Spots, row_delay: float, rate: Floats, camera: Camera) -> Spots:
    """The spots of a rolling shutter as they would be at the middle of the frame's exposure.

    Each spot is rotated, at the rates that the tracker knows, from the time of its row to the time
    of the middle row.

    row_delay  second, value that the tracker assumes
    rate       (3,) radian / second about the camera's axes, rates that the tracker assumes
    camera     camera that the tracker assumes
    Accuracy   model: the rate is constant within an exposure; the row of a spot is the row of its
               centroid.
    """
    if not row_delay or not np.any(rate) or not len(spots):
        return spots
    late = row_delay * (spots.y - (camera.rows - 1) / 2)
    back = Rotation.from_rotvec(np.multiply.outer(late, rate))
    place = camera.project(back.apply(camera.unproject(np.column_stack([spots.x, spots.y]))))
    return replace(spots, x=place[:, 0].copy(), y=place[:, 1].copy())


def duration(detector: Detector) -> float:
    """Second, exposure of all rows of an image."""
    return detector.exposure * detector.rows


def _lines(detector: Detector) -> tuple[Detector, tuple[Line, ...]]:
    """The lines as a detector with a row for each line, and their positions on it."""
    assert detector.scan
    lines = detector.scan.all_lines
    middle = (len(lines) - 1) / 2
    return (
        replace(detector, rows=len(lines), scan=None),
        tuple(replace(line, row=line.row + middle) for line in lines),
    )


def expected_electrons(
    case: Case, stars: Stars, path: LineOfSight, icrs_to_camera: Rotation, streams: Streams
) -> Floats:
    """The expected electrons (rows, columns) of a trial's frame.

    path  as `line_of_sight` gives it
    """
    light = light_of(case, stars, icrs_to_camera, streams)
    return expected(exposure_of(case.instrument, light, path, icrs_to_camera, streams))


def exposure_of(
    instrument: Instrument,
    light: Light,
    path: LineOfSight,
    icrs_to_camera: Rotation,
    streams: Streams,
    turn: MotionRealisation | None = None,
) -> Exposure:
    """All inputs of a trial's frame, except the noise.

    With residual charge (lag), the camera has the same rate in the previous frame. All earlier
    frames are assumed to be equal to the previous one.

    light  as `light_of` gives it
    path   as `line_of_sight` gives it, for the same `turn`
    """
    exposure = Exposure(
        light=light,
        psf=images_of(instrument),
        line_of_sight=path,
        icrs_to_camera=icrs_to_camera,
        camera=instrument.camera,
        detector=instrument.detector,
        throughput=throughput(instrument),
        motion_function=motion_function(instrument, streams, turn),
        of_colours=throughput_of_colours(instrument),
    )
    if not instrument.detector.lag:
        return exposure
    earlier, moved = motion_before(instrument, path, streams, turn)
    before = replace(
        exposure,
        line_of_sight=earlier,
        detector=replace(instrument.detector, lag=0.0),
        motion_function=moved,
    )
    return replace(exposure, residual_charge=expected(before))
