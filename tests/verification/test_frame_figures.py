"""Measurements of a design from frames: against the true design, and simulated images."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack import Refused, Streams, load_design, random_attitude, shipped
from startrack.budget import Term, analytic
from startrack.motion import Broadband, Motion, Tone, exposure_mean_rms, realise_motion
from startrack.prediction import (
    draw_unknowns,
    fit_surface,
    learn,
    predict,
    save_posterior,
    save_told,
)
from startrack.trial import observe
from startrack.verification import (
    expected_in_frames,
    told_by_frames,
    windows_of_frames,
    with_magnitudes,
)
from startrack.verification.windows_of_flight import Windows

FRAMES = 48
# A prototype of which optics, light and noise are known to a factor.
PROTOTYPE = """
base = "designs/noise_only.toml"
[instrument.optics]
blur = { median = "5 um", factor = 1.4 }
[instrument.optics.transmission]
factor = { median = 0.9, factor = 1.25 }
[instrument.detector]
read_noise = { median = "8 electron", factor = 1.5 }
"""
TRUTH = {
    "instrument.optics.blur": 0.8,
    "instrument.optics.transmission.factor": 0.12,  # 28 % darker than thought
    "instrument.detector.read_noise": 0.75,
}


def frames_of(case, count=FRAMES):
    """Frames whose stars move by a hundredth of a pixel from one to the next."""
    first, pixel = random_attitude(Streams(1, 0)), 1 / case.instrument.camera.focal_length_px
    turns = [Rotation.from_rotvec([0.01 * pixel * k, 0, 0]) * first for k in range(count)]
    return [observe(case, turn, Streams(3, k)).frame for k, turn in enumerate(turns)]


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    """The design of a prototype, the truth, and the frames' information on the design."""
    path = tmp_path_factory.mktemp("prototype") / "prototype.toml"
    path.write_text(PROTOTYPE)
    truth = load_design(path, quantile=TRUTH.__getitem__).case
    believed, frames = load_design(path).case, frames_of(truth)
    stars = with_magnitudes(windows_of_frames(frames, believed), frames[0], believed)
    return path, truth, told_by_frames(believed, stars, "frames of the prototype")


def test_frames_tell_what_made_them_and_not_what_was_thought(loop):
    path, truth, told = loop
    true, thought = expected_in_frames(truth), expected_in_frames(load_design(path).case)
    assert {one.figure for one in told} == {"read noise", "star signal", "image width"}
    for one in told:
        assert abs(math.log(one.number / true[one.figure])) < 3 * math.log(one.factor), one.name
        assert abs(math.log(one.number / thought[one.figure])) > 3 * math.log(one.factor), one.name


@pytest.mark.slow
def test_unknowns_are_learnt_from_frames(loop):
    """Each is within three sigma and much better known, including the light."""
    path, _, told = loop
    surface = fit_surface(draw_unknowns(path, 1, 10, 1, 0.0, middle=False))
    learned = learn(surface, told, 1)
    for posterior in learned.posteriors:
        name, law = posterior.unknown.name, posterior.unknown.law
        assert posterior.narrowing < 0.4, name
        median = float(str(law["median"]).split()[0])
        before = next(one for one in surface.unknowns if one.name == name)
        true = before.numbers(np.array([TRUTH[name]]))[0]
        assert abs(math.log(median / true)) < 3 * math.log(law["factor"]), name


def test_told_figures_of_frames_are_a_design(loop, tmp_path):
    path, _, told = loop
    save_told(tmp_path / "told.toml", path, told)
    design = load_design(tmp_path / "told.toml")
    assert [one.figure for one in design.told] == [one.figure for one in told]
    assert design.told[0].number == pytest.approx(told[0].number)
    assert len(design.unknowns) == len(TRUTH)


@pytest.mark.slow
def test_the_next_prediction_holds_the_truth(loop, tmp_path):
    """After the frames, and with the written posterior; a light that is 28 % off is rejected."""
    path, truth, told = loop
    after, posterior = tmp_path / "told.toml", tmp_path / "posterior.toml"
    save_told(after, path, told)
    found = predict(after, draws=10, units=1, age=0.0)
    save_posterior(posterior, after, found.learned)
    later = predict(posterior, draws=10, units=1, age=0.0)
    true = analytic(truth).term(Term.NOISE)
    for prediction in (found, later):
        for axis, value in zip(("across", "about"), true, strict=True):
            nea = prediction.figure("NEA", axis)
            assert nea.low_95 < value < nea.high_95
    light = next(one for one in found.learned.posteriors if one.unknown.name.endswith("n.factor"))
    assert light.unknown.law["median"] == pytest.approx(0.9 * 1.25**-1.175, rel=0.1)


def moving(common, noise, seed, names=("a", "b", "c"), rate=10.0):
    """Gaussian stars with a common motion in white steps, and single motions by noise; numpy's
    own."""
    rng = np.random.default_rng(seed)
    count = 400
    shared, step = common * rng.standard_normal((count, 2)), np.arange(8) - 3.5
    stars = []
    for number, name in enumerate(names):
        at = shared + noise * rng.standard_normal((count, 2)) + 0.1 * number
        profile = np.exp(-((step - at[:, :, None]) ** 2) / 2 / 0.9**2)
        image = profile[:, 1, :, None] * profile[:, 0, None, :] * 2000 / (2 * np.pi * 0.9**2)
        image += 2.0 * rng.standard_normal(image.shape)
        corner = np.tile([100 + 40 * number, 100], (count, 1))
        stars.append(Windows(name, np.arange(count) / rate, image, corner))
    return stars


def test_the_common_motion_is_that_of_all_stars():
    case = load_design(shipped("designs/noise_only.toml")).case
    detector = replace(case.instrument.detector, frame_rate=10.0)
    case = replace(case, instrument=replace(case.instrument, detector=detector))
    told = {one.figure: one for one in told_by_frames(case, moving(0.1, 0.03, 1))}
    motion = told["common motion"]
    assert abs(math.log(motion.number / 0.1)) < 3 * math.log(motion.factor)
    assert motion.factor < 1.1
    read = told["read noise"].number
    assert read == pytest.approx(2.0, rel=0.03)
    still = {one.figure for one in told_by_frames(case, moving(0.0, 0.03, 2))}
    other = {one.figure for one in told_by_frames(case, moving(0.1, 0.03, 1, rate=7.0))}
    alone = {one.figure for one in told_by_frames(case, moving(0.1, 0.03, 1, "a"))}
    assert "common motion" not in still | other | alone


def test_the_mean_of_an_exposure_moves_as_realised():
    """Against motions that are drawn and integrated over time."""
    motion = Motion(
        tones=(Tone(7.0, 1e-5, 2e-5, 0.0),),
        broadband=(Broadband("x", (1.0, 30.0), (1e-11, 1e-12)),),
    )
    exposure, found = 0.05, []
    for trial in range(60):
        drawn = realise_motion(motion, exposure, Streams(1, trial))
        part = exposure * (np.arange(200) + 0.5) / 200
        place = np.array([drawn.at(time + part).mean(axis=0) for time in np.linspace(0, 20, 50)])
        found.append(place - place.mean(axis=0))
    rms = np.sqrt(np.mean(np.square(found), axis=(0, 1)))
    assert exposure_mean_rms(motion, exposure) == pytest.approx(rms, rel=0.06)


def test_images_that_are_too_small_tell_nothing():
    case = load_design(shipped("designs/noise_only.toml")).case
    (star,) = moving(0.0, 0.03, 1, "a")
    small = replace(star, number=star.number[:, 1:7, 1:7])
    with pytest.raises(Refused, match="must have 8 x 8 pixels for told figures, got 6 x 6"):
        told_by_frames(case, [small])
