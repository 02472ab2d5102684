"""Spots drawn from bias and covariance, against rendered ones and the projection of the camera."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from startrack.core import YEAR, Curve, arcsec
from startrack.design.case import Fidelity
from startrack.detection import DarkMap, Detection
from startrack.detector import Age, Defects, Thermal
from startrack.motion import Tone
from startrack.trial import covariance
from startrack.trial.chain import run_random_trial, run_trials

from .designs import CASE, changed, with_detector


def rms(outcomes, axis):
    right = outcomes["solved"] & ~outcomes["false"]
    return np.sqrt(np.mean(outcomes[f"error_{axis}"][right] ** 2))


def test_a_trial_is_the_same_alone_and_in_company():
    together = run_trials(CASE, 4, range(200), Fidelity.COVARIANCE)
    for number in (0, 77, 199):
        alone = run_trials(CASE, 4, [number], Fidelity.COVARIANCE)
        assert alone.tobytes() == together[number : number + 1].tobytes()
    assert run_random_trial(CASE, 4, 77, Fidelity.COVARIANCE) == together[77].item()[1:]


def test_elements_without_a_star_may_hold_anything(monkeypatch):
    """New arrays are not cleared: a signalling NaN in one raises an error when it is added."""
    signalling = np.array(0x7FF0000000000001, np.uint64).view(np.float64)

    def filled(pixel, star, noise, matched, spots):
        pixel.view(np.uint64)[:] = noise.view(np.uint64)[:] = signalling.view(np.uint64)
        return drawn(pixel, star, noise, matched, spots)

    before = run_trials(CASE, 3, range(20), Fidelity.COVARIANCE)
    drawn = covariance.Drawn
    monkeypatch.setattr(covariance, "Drawn", filled)
    assert len(np.unique(before["stars"])) > 1
    assert run_trials(CASE, 3, range(20), Fidelity.COVARIANCE).tobytes() == before.tobytes()


@pytest.mark.parametrize("crosstalk", [pytest.param(0.0, marks=pytest.mark.slow), 0.1])
def test_trials_look_where_those_of_frames_look(crosstalk):
    """The number of detected stars is correlated with that of windows, trial by trial."""
    case = with_detector(crosstalk=crosstalk)
    drawn = run_trials(case, 4, range(30), Fidelity.COVARIANCE)
    rendered = run_trials(case, 4, range(30), Fidelity.WINDOW)
    assert np.corrcoef(drawn["stars"], rendered["stars"])[0, 1] > 0.98
    assert drawn["stars"].mean() == pytest.approx(rendered["stars"].mean(), rel=0.04)


@pytest.mark.parametrize("reference", ["instant", "mean"])
def test_jitter_is_that_of_rendered_trials(reference):
    """The same tones rotate the same trials: the difference between the two is the noise of
    both."""
    tones = (Tone(30.0, 5 * arcsec, 5 * arcsec), Tone(7.0, rms_y=3 * arcsec))
    shaken = changed(motion=dataclasses.replace(CASE.instrument.motion, tones=tones))
    case = dataclasses.replace(
        shaken, tracker=dataclasses.replace(shaken.tracker, reference=reference)
    )
    found = [
        run_trials(case, 4, range(40), fidelity)
        for fidelity in (Fidelity.WINDOW, Fidelity.SPOTS, Fidelity.COVARIANCE)
    ]
    for axis in "xy":
        rendered, *drawn = (each[f"error_{axis}"] / arcsec for each in found)
        assert (rms(found[0], axis) > 3 * arcsec) == (reference == "instant")
        for each in drawn:
            # 0.5 arcsec of noise in each of the two; chi-square of 40, false alarm 1e-4.
            assert np.mean((each - rendered) ** 2) < 2 * 0.55**2 * 2.1


@pytest.mark.slow
def test_errors_are_those_of_rendered_trials():
    """Within the stated 5 % plus 3 standard deviations of 3000 trials, on each axis."""
    drawn = run_trials(CASE, 4, range(20_000), Fidelity.COVARIANCE)
    rendered = run_trials(CASE, 4, range(3000), Fidelity.WINDOW)
    for axis in "xyz":
        doubt = 3 * np.sqrt(stats.kurtosis(rendered[f"error_{axis}"]) + 2) / 2 / np.sqrt(3000)
        assert rms(drawn, axis) == pytest.approx(rms(rendered, axis), rel=0.05 + doubt)
    assert drawn["nees"].mean() == pytest.approx(rendered["nees"].mean(), rel=0.15)


AGED = Age(time=5 * YEAR, fluence=1e13 / YEAR)  # 1e9 protons / cm^2 a year
COLD = Thermal(temperature=263.0, reference=293.0, doubling=8.0)


@pytest.mark.parametrize(
    "detector",
    [
        {"defects": Defects(dsnu=200.0, hot=1e-3, hot_current=3000.0)},
        pytest.param({"age": AGED, "thermal": COLD}, marks=pytest.mark.slow),
    ],
    ids=["defects", "age"],
)
def test_dark_pixels_that_differ_do_what_they_do_in_windows(detector):
    """The rms across within 24 %, three standard deviations of 80 trials with few outliers."""
    case = with_detector(**detector)
    drawn = run_trials(case, 5, range(500), Fidelity.COVARIANCE)
    rendered = run_trials(case, 5, range(80), Fidelity.WINDOW)
    plain = run_trials(CASE, 5, range(120), Fidelity.COVARIANCE)
    across = [np.hypot(rms(one, "x"), rms(one, "y")) for one in (drawn, rendered, plain)]
    assert across[0] == pytest.approx(across[1], rel=0.24)
    assert across[1] > 1.3 * across[2]
    assert drawn["stars"].mean() == pytest.approx(rendered["stars"].mean(), rel=0.15)


def test_a_map_of_too_many_hot_pixels_is_refused():
    tracker = dataclasses.replace(CASE.tracker, detection=Detection(dark_map=DarkMap()))
    case = dataclasses.replace(with_detector(columns=256, rows=256, age=AGED), tracker=tracker)
    with pytest.raises(ValueError, match=r"marks at most 0\.3% of the pixels"):
        run_random_trial(case, 1, 0, Fidelity.COVARIANCE)


def test_a_misbelieved_camera_errs_by_its_own():
    """A principal point that is wrong by a pixel rotates every attitude by a pixel."""
    wrong = dataclasses.replace(CASE.instrument.camera, principal_x=1.0)
    case = dataclasses.replace(CASE, tracker=dataclasses.replace(CASE.tracker, camera=wrong))
    right, misled = (run_trials(one, 1, range(40), Fidelity.COVARIANCE) for one in (CASE, case))
    shift = np.abs(misled["error_y"] - right["error_y"]).mean()
    assert shift == pytest.approx(1 / CASE.instrument.camera.focal_length_px, rel=0.02)


def test_a_tracker_matches_the_stars_of_its_own_catalogue_alone():
    shallow = dataclasses.replace(CASE.catalog, limit_g=5.5)
    tracker = dataclasses.replace(CASE.tracker, catalog=shallow)
    case = dataclasses.replace(CASE, tracker=tracker)
    all_stars, few = (run_trials(one, 1, range(40), Fidelity.COVARIANCE) for one in (CASE, case))
    assert few["stars"].mean() < 0.35 * all_stars["stars"].mean()
    np.testing.assert_allclose(few["spots"], all_stars["spots"], atol=3)


def test_a_sky_without_stars_is_unsolved():
    blind = with_detector(quantum_efficiency=Curve((300e-9, 1200e-9), (1e-9, 1e-9)))
    outcomes = run_trials(blind, 1, range(5), Fidelity.COVARIANCE)
    assert not outcomes["solved"].any()
    assert np.isnan(outcomes["error_x"]).all()


@pytest.mark.parametrize("rate", [pytest.param(0.5, marks=pytest.mark.slow), 2.0])
def test_errors_in_slews_are_those_of_spots(rate):
    """Each star has its own covariance along and across its streak, about the boresight too.

    1200 and 400 trials: the ratio of the rms has a sigma of 4.1 %, which 15 % exceed once in 4000.
    """
    motion = dataclasses.replace(CASE.instrument.motion, rate_y=math.radians(rate))
    case = changed(motion=motion)
    drawn = run_trials(case, 3, range(1200), Fidelity.COVARIANCE)
    identified = run_trials(case, 3, range(400), Fidelity.SPOTS)
    for axis in "xyz":
        assert rms(drawn, axis) == pytest.approx(rms(identified, axis), rel=0.15)
    assert drawn["nees"].mean() == pytest.approx(3.0, rel=0.1)
