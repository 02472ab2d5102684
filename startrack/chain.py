"""One trial, one line a room, in the order in which the light goes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.attitude import solve
from startrack.camera import Camera
from startrack.case import Case, Instrument, Tracker
from startrack.catalog import Sky, open_sky
from startrack.detection import detect
from startrack.detector import Turn, expose
from startrack.error import Outcome, judge
from startrack.identification import PatternIndex, build_index, identify
from startrack.motion import shake, turn
from startrack.optics import focus
from startrack.scene import WAVELENGTH, blackbody_photons, illuminate
from startrack.scene.photometry import SUN
from startrack.streams import Streams
from startrack.values import Estimate, Frame, Matches, Path, Psf, Spots, Stars

EDGE = 0.5  # degree beyond the corners from which a slewing or blurred star can reach the frame


@dataclass(frozen=True, eq=False)
class Record:
    """Everything that one trial made, for those who want to look at more than its outcome.

    icrs_to_camera  true attitude at the middle of the exposure
    path            true motion around it; its first and last points are the start and the end
    """

    icrs_to_camera: Rotation
    stars: Stars
    frame: Frame
    spots: Spots
    matches: Matches
    estimate: Estimate
    outcome: Outcome
    path: Path


def trial(case: Case, seed: int, number: int) -> Outcome:
    """The outcome of trial `number` of a seed: random attitude, random noise."""
    streams = Streams(seed, number)
    return observe(case, random_attitude(streams), streams).outcome


def observe(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Record:
    """Render, detect, identify, estimate, judge.

    icrs_to_camera  true attitude at the middle of the exposure
    Errors          ValueError where the case contradicts itself.
    """
    camera = case.instrument.camera
    stars = look(open_sky(case.catalog), icrs_to_camera, camera)
    light = illuminate(case.scene, stars)
    psf = psf_of(case.instrument)
    path = path_of(case.instrument, streams)
    frame = expose(
        light,
        psf,
        path,
        icrs_to_camera,
        camera,
        case.instrument.detector,
        throughput(case.instrument),
        streams,
        turn_of(case.instrument, streams),
    )
    spots, matches, estimate = track(
        frame, case.believed_camera, open_sky(case.believed_catalog).stars, case.tracker, psf
    )
    outcome = judge(estimate, asked_for(case, icrs_to_camera, streams), len(spots))
    return Record(icrs_to_camera, stars, frame, spots, matches, estimate, outcome, path)


def track(
    frame: Frame, camera: Camera, stars: Stars, tracker: Tracker, psf: Psf | None = None
) -> tuple[Spots, Matches, Estimate]:
    """What the flight software does with a frame, real or rendered.

    camera   as the tracker believes it
    stars    the tracker's catalogue
    tracker  its settings
    psf      as the tracker believes it; None: a Gaussian
    """
    spots = detect(frame, tracker.detection, psf)
    matches = identify(spots, camera, stars, index_of(stars, camera), tracker.identification)
    return spots, matches, solve(spots, matches, tracker.attitude)


def asked_for(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Rotation:
    """The attitude icrs_to_camera that a tracker must report for the spacecraft to have its own.

    Its time stamp may be late, and the camera may not sit as the tracker believes: the truth is
    the spacecraft's attitude at the time stated, taken back into the believed camera.
    """
    truth = icrs_to_camera
    if case.lateness:
        path = turn(case.instrument.motion, case.instrument.detector.exposure, streams)
        truth = Rotation.from_rotvec(path.at(np.array([case.lateness]))[0]) * truth
    mounting, believed = case.instrument.mounting, case.believed_mounting
    if mounting == believed:
        return truth
    phase = 2 * math.pi * streams("thermo-elastic").random() if mounting.swings else 0.0
    return believed.camera_to_body().inv() * mounting.camera_to_body(phase) * truth


def random_attitude(streams: Streams) -> Rotation:
    """An attitude icrs_to_camera, uniform over all rotations."""
    return Rotation.from_quat(streams("attitude").standard_normal(4))


def look(sky: Sky, icrs_to_camera: Rotation, camera: Camera) -> Stars:
    """The stars that can reach the frame, brightest first."""
    boresight = icrs_to_camera.inv().apply([0.0, 0.0, 1.0])
    return sky.stars[sky.cone(boresight, camera.half_diagonal + math.radians(EDGE))]


@lru_cache(maxsize=8)
def psf_of(instrument: Instrument) -> Psf:
    """The PSF for sunlike stars, computed once per design."""
    detector = instrument.detector
    return focus(
        instrument.optics,
        detector.pitch,
        WAVELENGTH,
        detected(instrument),
        detector.fill_factor,
        detector.diffusion,
    )


def detected(instrument: Instrument) -> NDArray[np.float64]:
    """Electrons per second of a sunlike star in each spectral bin, on a scale of no meaning."""
    sunlike = blackbody_photons(WAVELENGTH, np.array([SUN]))[0]
    electrons = sunlike * throughput(instrument)
    electrons = electrons * instrument.detector.quantum_efficiency(WAVELENGTH)
    if not electrons.any():
        raise ValueError("transmission and quantum_efficiency must overlap between 320 and 1100 nm")
    return electrons


def path_of(instrument: Instrument, streams: Streams) -> Path:
    """The path of the line of sight in the exposure of one trial."""
    camera = instrument.camera
    return shake(
        instrument.motion,
        instrument.detector.exposure,
        1 / camera.focal_length_px,
        streams,
        camera.half_diagonal,
    )


def turn_of(instrument: Instrument, streams: Streams) -> Turn | None:
    """The same motion at any time, which only a rolling shutter asks for."""
    detector = instrument.detector
    if not detector.row_delay:
        return None
    return turn(instrument.motion, detector.exposure, streams).at


def throughput(instrument: Instrument) -> NDArray[np.float64]:
    """Area of the aperture times transmission, square metre in each spectral bin."""
    return instrument.optics.area * instrument.optics.transmission(WAVELENGTH)


def index_of(stars: Stars, camera: Camera) -> PatternIndex:
    """The pattern index of a catalogue; cameras of nearly the same field share one."""
    step = math.log(1.1)
    field = math.floor(math.log(min(camera.fov_x, camera.fov_y)) / step) * step
    return _index(stars, math.exp(field))


@lru_cache(maxsize=16)
def _index(stars: Stars, field_of_view: float) -> PatternIndex:
    return build_index(stars, field_of_view)
