"""Case and attitude -> what the detector is exposed to: stars, light, PSF, line of sight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.catalog import Sky, open_sky
from startrack.core import (
    Camera,
    FieldPsf,
    Floats,
    Frame,
    Ints,
    Light,
    LineOfSight,
    Psf,
    Stars,
    Streams,
    kept,
)
from startrack.design import Case, Instrument
from startrack.detection import (
    LONGEST_STREAK,
    STREAK,
    DarkFrames,
    Detection,
    DetectionPlan,
    plan_detection,
)
from startrack.detector import (
    YEAR,
    Exposure,
    MotionFunction,
    arriving,
    dark_frames,
    expected,
    mean_wavelength,
    to_frame,
)
from startrack.motion import realise_motion, sample_jitter
from startrack.optics import (
    Optics,
    add_ghosts,
    cube_psf,
    field_psf,
    open_optics,
    pixel_psf,
    stray_light,
)
from startrack.scene import SUN, WAVELENGTH, Sight, illuminate

PART = 2**14  # stars
# Kelvin, of blackbodies whose images those of all stars are interpolated between.
TEMPERATURES = np.array([50000.0, 8000.0, 4500.0, 2500.0])
EDGE = 0.5  # degree beyond the corners from which a slewing or blurred star can reach the frame


def random_attitude(streams: Streams) -> Rotation:
    """An attitude icrs_to_camera, uniform over all rotations."""
    return Rotation.from_quat(_quaternion(streams))


def random_attitudes(seed: int, numbers: Sequence[int]) -> Rotation:
    """`random_attitude` of some trials of a seed."""
    return Rotation.from_quat([_quaternion(Streams(seed, number)) for number in numbers])


def rotations_from_cube(cube: NDArray[np.float64]) -> Rotation:
    """Rotations of points (n, 3) in the unit cube, which are distributed as evenly as the points.

    Source: Shoemake (1992), Uniform random rotations, Graphics Gems III, 124.
    """
    radius, p, q = np.sqrt(cube[:, 0]), 2 * np.pi * cube[:, 1], 2 * np.pi * cube[:, 2]
    rest = np.sqrt(1 - cube[:, 0])
    x, y, z, w = rest * np.sin(p), rest * np.cos(p), radius * np.sin(q), radius * np.cos(q)
    return Rotation.from_quat(np.column_stack([x, y, z, w]))


def _quaternion(streams: Streams) -> NDArray[np.float64]:
    return streams("attitude").standard_normal(4)


def stars_in_field(sky: Sky, icrs_to_camera: Rotation, camera: Camera) -> Stars:
    """The stars that can reach the frame, brightest first."""
    return sky.stars[nearby(sky, icrs_to_camera, camera)]


def nearby(sky: Sky, icrs_to_camera: Rotation, camera: Camera) -> Ints:
    """Indices in the sky of the stars that can reach the frame, brightest first."""
    boresight = icrs_to_camera.as_matrix()[2]
    return sky.cone(boresight, camera.half_diagonal + math.radians(EDGE))


@kept(4)
def electrons_of(case: Case) -> Floats:
    """Electrons (n,) of each star of the sky in an exposure; kept for the 4 last cases."""
    stars, instrument = open_sky(case.catalog).stars, case.instrument
    camera, detector, through = instrument.camera, instrument.detector, throughput(instrument)
    # In parts, for their spectra take hundreds of bytes a star.
    starts = range(0, max(len(stars), 1), PART)
    parts = (illuminate(case.scene, stars[start : start + PART]) for start in starts)
    return np.concatenate([arriving(each, camera, detector, through)[0] for each in parts])


@kept(4)
def colours_of(case: Case) -> Floats:
    """Mean detected wavelength (n,) of each star of the sky, metre; kept for the 4 last cases."""
    stars, instrument = open_sky(case.catalog).stars, case.instrument
    starts = range(0, max(len(stars), 1), PART)
    parts = (illuminate(case.scene, stars[start : start + PART]) for start in starts)
    through = throughput(instrument)
    return np.concatenate([mean_wavelength(each, instrument.detector, through) for each in parts])


def light_of(case: Case, stars: Stars, icrs_to_camera: Rotation, streams: Streams) -> Light:
    """Light at the entrance pupil, with the stray light that passes the baffle."""
    instrument = case.instrument
    sight = Sight(icrs_to_camera, instrument.camera, case.catalog.faintest_g, streams)
    light = illuminate(case.scene, stars, sight)
    if instrument.ghosts is not None:
        light = add_ghosts(
            light, instrument.ghosts, instrument.optics, icrs_to_camera, instrument.camera,
            instrument.detector.pitch,
        )  # fmt: skip
    if instrument.baffle is None:
        return light
    return stray_light(
        light, instrument.baffle, instrument.optics, icrs_to_camera, instrument.camera
    )


@kept(8)
def psf_of(instrument: Instrument) -> Psf:
    """The PSF for sunlike stars, with a lens table its mean over the frame.

    Kept for the 8 last instruments.
    """
    if instrument.optics.tabulated:
        return _whole_images(instrument).mean(sunlike_colour(instrument))
    detector, spectrum = instrument.detector, detected_spectrum(instrument)
    return _one_psf(
        instrument.optics,
        detector.pitch,
        spectrum.tobytes(),
        detector.fill_factor,
        detector.diffusion,
    )


@kept(8)
def _one_psf(
    optics: Optics, pitch: float, photons: bytes, fill_factor: float, diffusion: float
) -> Psf:
    """`pixel_psf`; kept for the 8 last, which instruments of other exposures or noise share."""
    spectrum = np.frombuffer(photons)
    return pixel_psf(optics, pitch, WAVELENGTH, spectrum, fill_factor, diffusion)


def images_of(instrument: Instrument) -> Psf | FieldPsf:
    """What stars are rendered with; a lens table makes it depend on place and colour."""
    return field_psf_of(instrument) if instrument.optics.tabulated else psf_of(instrument)


@kept(8)
def field_psf_of(instrument: Instrument) -> FieldPsf:
    """The images of stars over the frame and their colour; kept for the 8 last instruments."""
    images, optics = _whole_images(instrument), instrument.optics
    if not optics.lens_colour:
        images = images.of_one_colour(sunlike_colour(instrument))
    if not optics.lens_field:
        images = images.of_one_place(sunlike_colour(instrument))
    return images


def _whole_images(instrument: Instrument) -> FieldPsf:
    """The images with all effects of the lens; instruments of one lens and detector share them."""
    instrument = instrument.imaged or instrument
    detector = instrument.detector
    spectra = instrument.detected_spectra(TEMPERATURES)
    return _computed(
        replace(instrument.optics, lens_field=True, lens_colour=True),
        instrument.lens_temperature,
        instrument.camera.ideal,
        detector.pitch,
        (spectra / spectra.max()).tobytes(),
        detector.fill_factor,
        detector.diffusion,
    )


@kept(4)
def _computed(
    optics: Optics, kelvin: float, camera: Camera, pitch: float, photons: bytes,
    fill_factor: float, diffusion: float,
) -> FieldPsf:  # fmt: skip
    """`field_psf` for blackbodies of all TEMPERATURES; kept for the 4 last lenses.

    photons  of `Instrument.detected_spectra`
    """
    spectra = np.frombuffer(photons).reshape(len(TEMPERATURES), -1)
    colour = spectra @ WAVELENGTH / spectra.sum(axis=1)
    order = np.argsort(colour)
    light = WAVELENGTH, spectra[order], colour[order], fill_factor, diffusion
    if optics.psf_file:
        return cube_psf(optics, camera, pitch, *light)
    return field_psf(open_optics(optics, kelvin), camera, pitch, *light)


def colour_range(instrument: Instrument) -> tuple[float, float]:
    """Mean detected wavelengths of the hottest and the coolest of TEMPERATURES, metre."""
    spectra = instrument.detected_spectra(TEMPERATURES[[0, -1]])
    blue, red = spectra @ WAVELENGTH / spectra.sum(axis=1)
    return float(blue), float(red)


def sunlike_colour(instrument: Instrument) -> float:
    """Mean detected wavelength of a sunlike star, metre."""
    spectrum = detected_spectrum(instrument)
    return float(spectrum @ WAVELENGTH / spectrum.sum())


def detection_plan(
    case: Case, detection: Detection | None = None, smear: tuple[float, float] | None = None
) -> DetectionPlan:
    """The plan of a tracker that knows the PSF of its design, made once per design.

    detection  None for that of the tracker
    smear      pixel, where the settings leave it out; None for `known_smear`
    """
    return _planned(*_settings(case, detection, smear))


@lru_cache(maxsize=64)
def _settings(
    case: Case, detection: Detection | None, smear: tuple[float, float] | None
) -> tuple[Instrument, Detection]:
    """The instrument of the design, and the settings with their smear; of the 64 last cases."""
    detection = detection or case.tracker.detection
    designed = case.as_designed
    return designed.instrument, with_smear(detection, *(smear or known_smear(designed)))


@kept(16)
def _planned(instrument: Instrument, detection: Detection) -> DetectionPlan:
    """The plan, whose dark map comes from dark frames of the detector."""

    def dark() -> DarkFrames:
        assert detection.dark_map
        detector, then = instrument.detector, detection.dark_map_age
        if then is not None and detector.age:
            detector = replace(detector, age=detector.age.of_map(then / YEAR))
        return DarkFrames(*dark_frames(detector, detection.dark_map.frames))

    return plan_detection(detection, psf_of(instrument), dark)


def as_believed(case: Case, frame: Frame) -> Frame:
    """A frame with the meaning that the tracker believes its numbers to have."""
    if case.design is None:
        return frame
    return to_frame(frame.image, case.as_designed.instrument.detector)


def known_smear(case: Case) -> tuple[float, float]:
    """Smear on the boresight (pixel, x and y) by the rates that the tracker knows.

    Zero where lines scan: each of their spots has its own time.
    """
    detector, motion = case.as_designed.instrument.detector, case.believed_motion
    if detector.scan:
        return 0.0, 0.0
    return smear_of(case, motion.rate_x, motion.rate_y)


def smear_of(case: Case, rate_x: float, rate_y: float) -> tuple[float, float]:
    """`smear` that the tracker of a case computes from rates (rad / s)."""
    exposure = case.as_designed.instrument.detector.exposure
    return smear(case.believed_camera, exposure, rate_x, rate_y)


def smear(camera: Camera, exposure: float, rate_x: float, rate_y: float) -> tuple[float, float]:
    """Smear on the boresight (pixel, x and y) in an exposure (s) at rates (rad / s).

    The sky turns by r: a star on the boresight moves by (r_y, -r_x).
    """
    scale = camera.focal_length_px * exposure
    return rate_y * scale, -rate_x * scale


def with_smear(detection: Detection, x: float, y: float) -> Detection:
    """The settings with a smear where they leave it out, unless it is too short to matter."""
    if detection.smear_x is not None or detection.smear_y is not None:
        return detection
    if not math.hypot(x, y) > STREAK:
        return detection
    scale = min(1.0, LONGEST_STREAK / max(abs(x), abs(y)))
    return replace(detection, smear_x=scale * x, smear_y=scale * y)


def detected_spectrum(instrument: Instrument) -> NDArray[np.float64]:
    """Electrons per second of a sunlike star in each spectral bin, on an arbitrary scale."""
    return instrument.detected_spectra(np.array([SUN]))[0]


def line_of_sight(instrument: Instrument, streams: Streams) -> LineOfSight:
    """The path of the line of sight in the exposure of one trial."""
    camera = instrument.camera
    return sample_jitter(
        instrument.motion,
        instrument.detector.exposure,
        1 / camera.focal_length_px,
        streams,
        camera.half_diagonal,
    )


def motion_function(instrument: Instrument, streams: Streams) -> MotionFunction | None:
    """The motion of `line_of_sight` at any time; None except for a rolling shutter."""
    detector = instrument.detector
    if not detector.row_delay:
        return None
    return realise_motion(instrument.motion, detector.exposure, streams).over


def expected_electrons(
    case: Case, stars: Stars, path: LineOfSight, icrs_to_camera: Rotation, streams: Streams
) -> NDArray[np.float64]:
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
) -> Exposure:
    """What the frame of a trial depends on, except its noise.

    light  as `light_of` gives it
    path   as `line_of_sight` gives it
    """
    return Exposure(
        light,
        images_of(instrument),
        path,
        icrs_to_camera,
        instrument.camera,
        instrument.detector,
        throughput(instrument),
        motion_function(instrument, streams),
        residual_charge(instrument, light, path, icrs_to_camera, streams),
    )


def residual_charge(
    instrument: Instrument,
    light: Light,
    path: LineOfSight,
    icrs_to_camera: Rotation,
    streams: Streams,
) -> NDArray[np.float64] | None:
    """The expected electrons of the frame before; None for a detector without lag.

    The camera turned then as it turns now; the frames before that one are taken to be like it.
    """
    detector = instrument.detector
    if not detector.lag:
        return None
    earlier, moved = motion_before(instrument, path, streams)
    exposure = Exposure(
        light,
        images_of(instrument),
        earlier,
        icrs_to_camera,
        instrument.camera,
        replace(detector, lag=0.0),
        throughput(instrument),
        moved,
    )
    return expected(exposure)


def motion_before(
    instrument: Instrument, path: LineOfSight, streams: Streams
) -> tuple[LineOfSight, MotionFunction]:
    """The line of sight in the exposure of the frame before, and its motion at any time."""
    detector = instrument.detector
    motion, late = (
        realise_motion(instrument.motion, detector.exposure, streams),
        1 / detector.update_rate,
    )
    earlier = replace(path, rotation=motion.at(path.time - late))
    return earlier, lambda start, step: motion.over(start - late, step)


def throughput(instrument: Instrument) -> NDArray[np.float64]:
    """Area of the aperture times transmission, square metre in each spectral bin."""
    return instrument.optics.area * instrument.optics.transmission(WAVELENGTH)


def reference_attitude(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Rotation:
    """The attitude icrs_to_camera that a tracker must report, so that the spacecraft's is correct.

    Its time tag may be late, and the mounting may differ from the believed one: the reference is
    the spacecraft's attitude at the time tag, in the axes of the believed camera.
    """
    truth = icrs_to_camera
    if case.time_tag_error:
        path = realise_motion(case.instrument.motion, case.instrument.detector.exposure, streams)
        truth = Rotation.from_rotvec(path.at(np.array([case.time_tag_error]))[0]) * truth
    mounting, believed = case.instrument.mounting, case.believed_mounting
    if mounting == believed:
        return truth
    phase = 2 * math.pi * streams("thermo-elastic").random() if mounting.swings else 0.0
    return believed.camera_to_body().inv() * mounting.camera_to_body(phase) * truth
