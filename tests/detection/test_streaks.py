"""The smear of a frame from its own streaks, against the motion that made it."""

import dataclasses

import numpy as np
import pytest

from startrack import load_design, random_attitude, run_trials, shipped
from startrack.core import Frame, Streams, arcsec, deg
from startrack.design import Fidelity
from startrack.detection import detect, plan_detection, refined, streak_of
from startrack.observation import detection_plan
from startrack.trial import observe

CASE = load_design(shipped("designs/noise_only.toml")).case


def turning(rate, angle, **detector):
    """The example at a rate (deg/s), with a tracker that knows no rate."""
    x, y = rate * deg * np.cos(angle), rate * deg * np.sin(angle)
    instrument = dataclasses.replace(
        CASE.instrument,
        motion=dataclasses.replace(CASE.instrument.motion, rate_x=x, rate_y=y),
        detector=dataclasses.replace(CASE.instrument.detector, **detector),
    )
    tracker = dataclasses.replace(CASE.tracker, rate="images")
    return dataclasses.replace(CASE, instrument=instrument, tracker=tracker)


@pytest.mark.parametrize("rate", [pytest.param(1.0, marks=pytest.mark.slow), 3.0])
def test_the_smear_is_that_of_the_motion(rate):
    case = turning(rate, 0.7)
    motion, camera = case.instrument.motion, case.instrument.camera
    scale = camera.focal_length_px * case.instrument.detector.exposure
    true = np.array([motion.rate_y, -motion.rate_x]) * scale
    streams = Streams(3, 0)
    frame = observe(case, random_attitude(streams), streams).frame
    plan = detection_plan(case, smear=(0.0, 0.0))
    found = streak_of(frame, plan)
    spots = detect(frame, detection_plan(case, smear=(found.x, found.y)))
    for guess, within in ((found, 1.2), (refined(frame, plan, spots, found), 0.6)):
        assert guess.seen
        smear = np.array([guess.x, guess.y])
        assert np.hypot(*(smear * np.sign(smear @ true) - true)) < within


@pytest.mark.parametrize("frames", [12, pytest.param(40, marks=pytest.mark.slow)])
def test_noise_and_uneven_rows_make_no_streak(frames):
    """Without a star, but with levels of rows and columns and with hot pixels."""
    rng = np.random.default_rng(4)
    plan = plan_detection(CASE.tracker.detection, None)
    for _ in range(frames):
        image = rng.normal(100, 5, (200, 240)) + rng.normal(0, 3, (200, 1)) + rng.normal(0, 3, 240)
        image.flat[rng.choice(image.size, 60)] += 400
        frame = Frame(image.astype(np.float32), 0.1, 1.0, 5.0, 0.0)
        assert not streak_of(frame, plan).seen


@pytest.mark.parametrize("angle", [2.0, pytest.param(2.0 - np.pi, marks=pytest.mark.slow)])
def test_a_tracker_that_is_told_no_rate_finds_its_attitude_while_it_turns(angle):
    """At 2 deg/s, with a shutter that skews the frame by 1.1 pixel, it equals a tracker that knows
    the rate.

    A tracker that ignores the streaks has 5 times the error.
    """
    case = turning(2.0, angle, row_delay=20e-6)
    known = dataclasses.replace(case, tracker=dataclasses.replace(case.tracker, rate="known"))
    told, alone = (run_trials(one, 5, range(8)) for one in (known, case))
    assert alone["solved"].all()
    assert not alone["false"].any()
    rms = [np.sqrt(np.mean(one["error_x"] ** 2 + one["error_y"] ** 2)) for one in (told, alone)]
    assert rms[1] < 1.5 * rms[0]
    assert rms[1] < 3 * arcsec
    with pytest.raises(ValueError, match="a rate"):
        run_trials(case, 5, [0], Fidelity.WINDOW)
