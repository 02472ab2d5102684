"""Case -> values that its tracker assumes: detection plan, meaning of the numbers, smear."""

import math
from dataclasses import replace
from functools import lru_cache, partial

from startrack.core import YEAR, Camera, Frame, kept
from startrack.design import Case, Instrument
from startrack.detection import (
    LONGEST_STREAK,
    STREAK,
    DarkFrames,
    Detection,
    DetectionPlan,
    detect,
    plan_detection,
    refined,
    streak_of,
)
from startrack.detector import Detector, dark_frames, to_frame
from startrack.observation.images import psf_of

# Pixel: smear is rounded to this step, so that frames at nearly the same rate share a plan. An
# error of half a step has no measurable effect.
SMEAR_STEP = 0.25


def detection_plan(
    case: Case, detection: Detection | None = None, smear: tuple[float, float] | None = None
) -> DetectionPlan:
    """The plan of a tracker that knows the PSF of its design, made once per design.

    detection  settings; None: `tracker.detection`
    smear      pixel, used if the settings have no smear; None: `known_smear`
    """
    return _planned(*_settings(case, detection, smear))


@lru_cache(maxsize=64)
def _settings(
    case: Case, detection: Detection | None, smear: tuple[float, float] | None
) -> tuple[Instrument, Detection]:
    """The design's instrument, and the settings with their smear; cached for the last 64 cases."""
    detection = detection or case.tracker.detection
    designed = case.as_designed
    return designed.instrument, with_smear(detection, *(smear or known_smear(designed)))


@kept(16)
def _planned(instrument: Instrument, detection: Detection) -> DetectionPlan:
    """The plan, whose dark map comes from dark frames of the detector."""
    dark = partial(frames_of_map, instrument.detector, detection)
    return plan_detection(detection, psf_of(instrument), dark)


def frames_of_map(detector: Detector, detection: Detection) -> DarkFrames:
    """Dark frames of a device, at its age when the tracker took them for its dark map."""
    assert detection.dark_map
    then = detection.dark_map_age
    if then is not None and detector.age:
        detector = replace(detector, age=detector.age.of_map(then / YEAR))
    return DarkFrames(*dark_frames(detector, detection.dark_map.frames))


def as_believed(case: Case, frame: Frame) -> Frame:
    """A frame with the meaning of its numbers (gain, offset, noise) that the tracker assumes."""
    if case.design is None:
        return frame
    return to_frame(frame.image, case.as_designed.instrument.detector)


def seen_smear(case: Case, frame: Frame) -> tuple[float, float]:
    """Smear (pixel, x and y) that the streaks of a frame show; its sign is unknown."""
    frame, still = as_believed(case, frame), detection_plan(case, smear=(0.0, 0.0))
    coarse = streak_of(frame, still)
    if not coarse.seen:
        return 0.0, 0.0
    x, y = (SMEAR_STEP * round(side / SMEAR_STEP) for side in (coarse.x, coarse.y))
    streak = refined(frame, still, detect(frame, detection_plan(case, smear=(x, y))), coarse)
    # The refined streak is not rounded to SMEAR_STEP, which would increase the error at 3 deg/s by
    # 1/40.
    return streak.x, streak.y


def known_smear(case: Case) -> tuple[float, float]:
    """Smear on the boresight (pixel, x and y) by the rates that the tracker knows.

    It is zero for a detector that scans, because each of its spots has its own time.
    """
    detector, motion = case.as_designed.instrument.detector, case.believed_motion
    if detector.scan:
        return 0.0, 0.0
    return smear_of(case, motion.rate_x, motion.rate_y)


def smear_of(case: Case, rate_x: float, rate_y: float) -> tuple[float, float]:
    """The smear (`smear`) that the tracker of a case computes from rates (rad / s)."""
    exposure = case.as_designed.instrument.detector.exposure
    return smear(case.believed_camera, exposure, rate_x, rate_y)


def smear(camera: Camera, exposure: float, rate_x: float, rate_y: float) -> tuple[float, float]:
    """Smear on the boresight (pixel, x and y) of an exposure (s) at rates (rad / s).

    If the sky rotates by r, a star on the boresight moves by (r_y, -r_x).
    """
    scale = camera.focal_length_px * exposure
    return rate_y * scale, -rate_x * scale


def with_smear(detection: Detection, x: float, y: float) -> Detection:
    """The settings with the given smear, unless they have one.

    Only the method "likelihood" uses a smear below `STREAK`. Without it, its error is 3.7 times as
    large for stars of 0.33 pixel (sigma).
    """
    if detection.smear_x is not None or detection.smear_y is not None:
        return detection
    least = 0.0 if detection.centroid == "likelihood" else STREAK
    if not math.hypot(x, y) > least:
        return detection
    scale = min(1.0, LONGEST_STREAK / max(abs(x), abs(y)))
    # A rounded product may exceed the longest streak.
    x, y = (max(-LONGEST_STREAK, min(scale * side, LONGEST_STREAK)) for side in (x, y))
    return replace(detection, smear_x=x, smear_y=y)
