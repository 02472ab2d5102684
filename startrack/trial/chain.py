"""One trial from stars to outcome: one line for each stage, in the order of the light."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude import solve
from startrack.catalog import Selection, open_sky
from startrack.core import Estimate, Floats, Frame, Matches, Rows, Spots, Streams, printed
from startrack.design import Case, Fidelity, Tracker
from startrack.detection import corrected, detect
from startrack.detector import expose
from startrack.identification import PatternIndexes, identify, refit
from startrack.metrics import JUDGED, Outcome, judge
from startrack.motion import MotionRealisation
from startrack.observation import (
    as_believed,
    at_one_time,
    detection_plan,
    exposure_of,
    light_of,
    line_of_sight,
    random_attitude,
    reference_attitude,
    seen_smear,
    smear,
    stars_in_field,
    straighten,
    sweep,
    with_smear,
)
from startrack.response import TrackerKnowledge, knowledge_of
from startrack.trial.boxes import agreeing, boxed, boxes_in_windows, expected_attitude, follow_boxes
from startrack.trial.covariance import outcomes as drawn_outcomes
from startrack.trial.spots import spots_of
from startrack.trial.window import spots_in_windows

MANY = 0.8  # a sign of the motion with fewer than 0.8 of the other sign's matches is not compared


@printed
@dataclass(frozen=True, eq=False)
class Record:
    """All results of one trial.

    icrs_to_camera  true attitude at the middle of the exposure
    path            true motion relative to this attitude, from the start to the end of the exposure
    """

    icrs_to_camera: Rotation
    stars: core.Stars
    frame: Frame
    spots: Spots
    matches: Matches
    estimate: Estimate
    outcome: Outcome
    path: core.LineOfSight


# A row of the table of trials: its number, and the fields of Outcome.
OUTCOMES: np.dtype[np.void] = np.dtype([("trial", np.int64), *JUDGED.descr])


def run_trials(
    case: Case,
    seed: int,
    numbers: Sequence[int],
    fidelity: Fidelity = Fidelity.FRAME,
    icrs_to_camera: Rotation | None = None,
) -> Rows:
    """The outcomes of some trials of a seed; each is independent of the other trials that are run.

    icrs_to_camera  a true attitude for each; None: the random ones of `run_random_trial`
    Returns  (n,) structured array: `trial` and the fields of Outcome
    Raises   as `run_trial`, with a note that names the trial.
    """
    outcomes = np.empty(len(numbers), OUTCOMES)
    outcomes["trial"] = numbers
    if fidelity is Fidelity.COVARIANCE:
        try:
            outcomes[list(Outcome._fields)] = drawn_outcomes(case, seed, numbers, icrs_to_camera)
        except Exception as error:
            error.add_note(f"in trials {numbers[0]} to {numbers[-1]} of seed {seed}")
            raise
        return outcomes
    for n, number in enumerate(numbers):
        streams = Streams(seed, number)
        attitude = random_attitude(streams) if icrs_to_camera is None else icrs_to_camera[n]
        try:
            outcomes[n] = (number, *run_trial(case, attitude, streams, fidelity))
        except Exception as error:
            error.add_note(f"in trial {number} of seed {seed}")
            raise
    return outcomes


def run_random_trial(
    case: Case, seed: int, number: int, fidelity: Fidelity = Fidelity.FRAME
) -> Outcome:
    """The outcome of trial `number` of a seed: random attitude, random noise.

    Raises  ValueError if the case contradicts itself or needs a more detailed fidelity.
    """
    streams = Streams(seed, number)
    return run_trial(case, random_attitude(streams), streams, fidelity)


def run_trial(
    case: Case, icrs_to_camera: Rotation, streams: Streams, fidelity: Fidelity = Fidelity.FRAME
) -> Outcome:
    """The outcome of a trial at a given attitude; exceptions as for `run_random_trial`."""
    if fidelity is Fidelity.FRAME:
        return observe(case, icrs_to_camera, streams).outcome
    if fidelity is Fidelity.COVARIANCE:
        alone = Rotation.concatenate([icrs_to_camera])
        return Outcome(*drawn_outcomes(case, streams.seed, [streams.trial], alone)[0].item())
    if fidelity is Fidelity.SPOTS:
        return drawn(case, icrs_to_camera, streams)[-1]
    if boxed(case):
        spots, matches = boxes_in_windows(case, icrs_to_camera, streams)
        spots = _at_one_time(case, spots)
    else:
        spots = _at_one_time(case, spots_in_windows(case, icrs_to_camera, streams))
        matches = _identified(case, spots)
    return _judged(case, icrs_to_camera, streams, spots, matches)[1]


def drawn(
    case: Case, icrs_to_camera: Rotation, streams: Streams
) -> tuple[Spots, Matches, Estimate, Outcome]:
    """A trial of fidelity `spots`, with all results of the tracker."""
    spots = _at_one_time(case, spots_of(case, icrs_to_camera, streams))
    matches = _identified(case, spots)
    return spots, matches, *_judged(case, icrs_to_camera, streams, spots, matches)


def observe(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Record:
    """A trial of fidelity `frame` at a given attitude, with all its results.

    icrs_to_camera  true attitude at the middle of the exposure
    Raises          ValueError if the case contradicts itself.
    """
    frame, stars, path = frame_at(case, icrs_to_camera, streams)
    if boxed(case):
        expected = expected_attitude(case, icrs_to_camera, streams)
        spots, matches, _ = follow_boxes(case, frame, case.believed_camera, expected, {})
        spots = _at_one_time(case, spots)
    elif case.tracker.rate == "images":
        spots, matches = _detected_turning(case, frame)
    else:
        spots = _detected(case, frame)
        matches = _identified(case, spots)
    estimate, outcome = _judged(case, icrs_to_camera, streams, spots, matches)
    return Record(
        icrs_to_camera=icrs_to_camera,
        stars=stars,
        frame=frame,
        spots=spots,
        matches=matches,
        estimate=estimate,
        outcome=outcome,
        path=path,
    )


def frame_at(
    case: Case, icrs_to_camera: Rotation, streams: Streams, turn: MotionRealisation | None = None
) -> tuple[Frame, core.Stars, core.LineOfSight]:
    """The frame of a matrix, or the image of scanning lines; also its stars and path.

    icrs_to_camera  true attitude at the middle of the exposure
    turn            motion of the camera relative to this attitude; None: the motion of the design.
                    Not for lines
    """
    instrument = case.instrument
    stars = stars_in_field(open_sky(case.catalog), icrs_to_camera, instrument.camera)
    light = light_of(case, stars, icrs_to_camera, streams)
    path = line_of_sight(instrument, streams, turn)
    if instrument.detector.scan:
        return sweep(case, light, icrs_to_camera, streams), stars, path
    exposure = exposure_of(instrument, light, path, icrs_to_camera, streams, turn)
    return expose(exposure, streams), stars, path


def _detected(case: Case, frame: Frame) -> Spots:
    """The spots of a frame; spots of scanning lines are moved to their places at time zero."""
    detector = case.as_designed.instrument.detector
    spots = detect(as_believed(case, frame), detection_plan(case))
    if not detector.scan:
        return _at_one_time(case, spots)
    return straighten(
        spots, detector.scan, detector.exposure, case.believed_motion, case.believed_camera
    )


def _detected_turning(case: Case, frame: Frame) -> tuple[Spots, Matches]:
    """Spots and matches of a frame by a tracker that is given no rate.

    With a rolling shutter, the spots depend on the sign of the rate. Of two signs with about the
    same number of matched stars, the tracker takes the sign with the better match.
    """
    x, y = seen_smear(case, frame)
    spots = detect(as_believed(case, frame), detection_plan(case, smear=(x, y)))
    delay, camera = case.believed_row_delay, case.believed_camera
    if not (delay and (x or y)):
        return spots, _identified(case, spots)
    scale = camera.focal_length_px * case.as_designed.instrument.detector.exposure
    rate = np.array([-y, x, 0.0]) / scale
    tried = []
    for sign in (1.0, -1.0):
        moved = at_one_time(spots, delay, sign * rate, camera)
        matches = _identified(case, moved)
        estimate = solve_matches(moved, matches, case.tracker, knowledge_of(case))
        tried.append((estimate.stars, estimate.residual_rms, moved, matches))
    most = max(stars for stars, *_ in tried)
    good = [attempt for attempt in tried if attempt[0] >= MANY * most]
    _, _, spots, matches = min(good, key=lambda attempt: attempt[1])
    return spots, matches


def _at_one_time(case: Case, spots: Spots) -> Spots:
    rates, camera = case.believed_motion.rates, case.believed_camera
    return at_one_time(spots, case.believed_row_delay, rates, camera)


def searched(case: Case, frame: Frame) -> Frame:
    """The frame that the tracker searches: dark map subtracted, hot pixels interpolated."""
    plan = detection_plan(case)
    if plan.correction is None:
        return frame
    pixels = corrected(frame.image.astype(np.float32), plan.correction, plan.settings.saturation)
    return replace(frame, image=pixels)


def _identified(case: Case, spots: Spots) -> Matches:
    """Match the spots with stars of the tracker's catalogue."""
    indexes, camera = pattern_indexes(case.believed_catalog), case.believed_camera
    return identify(spots, camera, indexes.stars, indexes(camera), case.tracker.identification)


def _judged(
    case: Case, icrs_to_camera: Rotation, streams: Streams, spots: Spots, matches: Matches
) -> tuple[Estimate, Outcome]:
    """The attitude that the tracker estimates, and its error against the true one."""
    tracker = agreeing(case.tracker) if boxed(case) else case.tracker
    estimate = solve_matches(spots, matches, tracker, knowledge_of(case))
    return estimate, judge(estimate, reference_attitude(case, icrs_to_camera, streams), len(spots))


def lost_in_space(
    frame: Frame,
    camera: core.Camera,
    indexes: PatternIndexes,
    tracker: Tracker,
    psf: core.Psf | None = None,
    knowledge: TrackerKnowledge | None = None,
) -> tuple[Spots, Matches, Estimate]:
    """Run the flight software on a frame, real or rendered.

    camera     camera that the tracker assumes
    indexes    pattern indexes of the tracker's catalogue
    tracker    settings; if they include a motion, stars are measured as streaks of this motion
    psf        PSF that the tracker assumes; None: a Gaussian
    knowledge  knowledge of the tracker's errors, from `startrack.response.knowledge_of`; None: each
               star has the systematic error tracker.attitude.centroid_floor
    """
    settings = tracker.detection
    if tracker.motion and math.isfinite(frame.exposure):
        rates = tracker.motion.rate_x, tracker.motion.rate_y
        settings = with_smear(settings, *smear(camera, frame.exposure, *rates))
    spots = detect(frame, settings, psf)
    return spots, *identify_and_solve(spots, camera, indexes, tracker, knowledge)


def identify_and_solve(
    spots: Spots,
    camera: core.Camera,
    indexes: PatternIndexes,
    tracker: Tracker,
    knowledge: TrackerKnowledge | None = None,
) -> tuple[Matches, Estimate]:
    """Run the flight software on its spots; arguments as for `lost_in_space`."""
    settings = tracker.identification
    matches = identify(spots, camera, indexes.stars, indexes(camera), settings)
    return matches, solve_matches(spots, matches, tracker, knowledge)


def solve_matches(
    spots: Spots, matches: Matches, tracker: Tracker, knowledge: TrackerKnowledge | None = None
) -> Estimate:
    """The attitude from matched stars; arguments as for `lost_in_space`."""
    settings, tolerance = tracker.attitude, tracker.identification.focal_tolerance
    if knowledge is None:
        return solve(spots, matches, settings, tolerance)
    if knowledge.stretch is not None and len(matches):
        spots, matches = shrunk(spots, matches, tracker, knowledge.stretch)
    return solve(spots, matches, settings, tolerance, knowledge.of(matches.star))


def shrunk(
    spots: Spots, matches: Matches, tracker: Tracker, stretch: Floats
) -> tuple[Spots, Matches]:
    """Spots corrected for their stars' colour, with the focal length of sunlike stars.

    stretch  (n,) 1, relative excess of the focal length for the colour of each catalogue star
    """
    x, y = spots.x.copy(), spots.y.copy()
    longer = 1 + stretch[matches.star]
    for place, centre in zip((x, y), matches.camera.centre, strict=True):
        place[matches.spot] = centre + (place[matches.spot] - centre) / longer
    spots, camera = replace(spots, x=x, y=y), matches.camera
    if matches.icrs_to_camera is not None:
        camera = refit(spots, matches, camera, tracker.identification)
    return spots, replace(matches, camera=camera)


@lru_cache(maxsize=16)
def pattern_indexes(catalog: Selection) -> PatternIndexes:
    """The pattern indexes of a tracker's catalogue; cached for the last 16 catalogues."""
    return PatternIndexes(open_sky(catalog).stars)
