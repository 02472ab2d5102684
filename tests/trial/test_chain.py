import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.streams import Streams
from startrack.core.values import Status
from startrack.design import replaced
from startrack.design.files import load_design
from startrack.io import shipped
from startrack.metrics import Outcome
from startrack.motion import Motion, Tone
from startrack.observation.images import psf_of
from startrack.observation.pointing import random_attitude, reference_attitude
from startrack.response import knowledge_of
from startrack.trial.chain import lost_in_space, observe, pattern_indexes, run_random_trial

CASE = load_design(shipped("designs/noise_only.toml")).case


def test_a_trial_finds_its_attitude():
    outcome = run_random_trial(CASE, 1, 0)
    assert isinstance(outcome, Outcome)
    assert outcome.solved
    assert not outcome.false
    assert np.degrees(np.hypot(outcome.error_x, outcome.error_y)) * 3600 < 5


def test_a_trial_repeats_itself():
    assert run_random_trial(CASE, 2, 7) == run_random_trial(CASE, 2, 7)


def test_spots_lie_where_the_stars_are():
    """Each bright star inside the frame has a spot within a quarter of a pixel."""
    streams = Streams(3, 1)
    record = observe(CASE, random_attitude(streams), streams)
    camera = CASE.instrument.camera
    pixel = camera.project(record.icrs_to_camera.apply(record.stars.direction))
    bright = camera.holds(pixel, -10) & (record.stars.magnitude_g < 5.5)
    spots = np.column_stack([record.spots.x, record.spots.y])
    alone = [place for place in pixel[bright] if np.sort(np.hypot(*(pixel - place).T))[1] > 10]
    assert len(alone) > 3
    for place in alone:
        assert np.hypot(*(spots - place).T).min() < 0.25


def test_belief_is_kept_apart_from_truth():
    """A tracker that believes a wrong principal point errs by exactly that, on the same frame."""
    wrong = dataclasses.replace(CASE.instrument.camera, principal_x=1.0)
    case = dataclasses.replace(CASE, tracker=dataclasses.replace(CASE.tracker, camera=wrong))
    streams = Streams(1, 0)
    attitude = random_attitude(streams)
    right, misled = (observe(one, attitude, streams) for one in (CASE, case))
    np.testing.assert_array_equal(right.frame.image, misled.frame.image)
    shift = misled.outcome.error_y - right.outcome.error_y
    assert abs(shift) == pytest.approx(1 / CASE.instrument.camera.focal_length_px, rel=0.01)


def test_an_unknown_aberration_shows_as_an_error():
    """The Earth's 30 km/s displace the whole field by up to 20.5 arcsec, and the attitude with
    it."""
    sky = dataclasses.replace(CASE.catalog, aberration=True)
    case = dataclasses.replace(
        CASE, catalog=sky, tracker=dataclasses.replace(CASE.tracker, catalog=CASE.catalog)
    )
    shift = []
    for number in range(12):
        outcome = run_random_trial(case, 8, number)
        shift.append(np.degrees(np.hypot(outcome.error_x, outcome.error_y)) * 3600)
    assert 17 < max(shift) < 22
    corrected = run_random_trial(dataclasses.replace(CASE, catalog=sky), 8, int(np.argmax(shift)))
    assert np.degrees(np.hypot(corrected.error_x, corrected.error_y)) * 3600 < 5


def test_a_closed_shutter_is_a_status():
    """No light: an empty frame is data, not an error."""
    dark = dataclasses.replace(CASE.instrument.detector, exposure=1e-9)
    case = dataclasses.replace(CASE, instrument=dataclasses.replace(CASE.instrument, detector=dark))
    streams = Streams(1, 0)
    record = observe(case, random_attitude(streams), streams)
    assert record.estimate.status in (Status.BLANK, Status.TOO_FEW, Status.NO_MATCH)
    assert not record.outcome.solved
    assert record.estimate.reason


def test_diffusion_widens_the_psf_by_its_variance():
    """Variances of convolved blurs add, in square micrometre."""
    variance = []
    for diffusion in (0.0, 3e-6):
        detector = dataclasses.replace(CASE.instrument.detector, diffusion=diffusion)
        psf = psf_of(dataclasses.replace(CASE.instrument, detector=detector))
        at = np.arange(len(psf.table)) / psf.oversampling - psf.half_width
        line = psf.table.sum(axis=0)
        variance.append((line @ at**2) / line.sum() * (detector.pitch * 1e6) ** 2)
    assert variance[1] - variance[0] == pytest.approx(9.0, rel=0.02)


def test_a_frame_is_solved_as_in_a_trial():
    """With the knowledge of the design's tracker, `lost_in_space` weights stars as the chain
    does."""
    streams = Streams(1, 0)
    record = observe(CASE, random_attitude(streams), streams)
    camera, indexes = CASE.believed_camera, pattern_indexes(CASE.believed_catalog)
    tracker = dataclasses.replace(CASE.tracker, motion=CASE.believed_motion)
    known = psf_of(CASE.instrument), knowledge_of(CASE)
    *_, estimate = lost_in_space(record.frame, camera, indexes, tracker, *known)
    np.testing.assert_array_equal(estimate.covariance, record.estimate.covariance)
    *_, other = lost_in_space(record.frame, camera, indexes, tracker, known[0])
    assert np.trace(other.covariance) > 1.2 * np.trace(estimate.covariance)


def test_the_mean_attitude_is_the_reference_where_it_is_asked_for():
    """The mean of a sinusoid over an exposure is sinc(f T) times its value in the middle."""
    frequency, rms, exposure = 17.0, 5e-6, CASE.instrument.detector.exposure
    for phase in (0.3, 2.0):
        tone = Tone(frequency, rms_x=rms, phase=phase)
        case = replaced(CASE, "instrument.motion", Motion(tones=(tone,)))
        mean = dataclasses.replace(
            case, tracker=dataclasses.replace(case.tracker, reference="mean")
        )
        at, streams = Rotation.identity(), Streams(1, 1)
        turn = reference_attitude(mean, at, streams) * reference_attitude(case, at, streams).inv()
        middle = np.sqrt(2) * rms * np.cos(phase)
        # The sky turns against the camera.
        expected = (np.sinc(frequency * exposure) - 1) * middle
        assert abs(turn.as_rotvec()[0]) == pytest.approx(abs(expected), rel=0.02)
        assert turn.as_rotvec()[1:] == pytest.approx(0, abs=1e-12)
