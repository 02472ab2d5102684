"""The control variate of a trial: zero on average, and nearly equal to the trial's error."""

import dataclasses

import numpy as np
import pytest

from startrack.catalog import Sky, open_sky
from startrack.core.streams import Streams
from startrack.design.files import load_design
from startrack.io import shipped
from startrack.montecarlo.attitudes import at_random
from startrack.montecarlo.control import control
from startrack.montecarlo.estimate import controlled, plain
from startrack.montecarlo.sampling import sample_controlled, squares, surplus
from startrack.observation.pointing import random_attitude
from startrack.observation.stars import stars_in_field

CASE = load_design(shipped("designs/noise_only.toml")).case
CAMERA = CASE.instrument.camera


def with_centroid(name):
    detection = dataclasses.replace(CASE.tracker.detection, centroid=name)
    tracker = dataclasses.replace(CASE.tracker, detection=detection)
    return dataclasses.replace(CASE, tracker=tracker)


@pytest.mark.parametrize(
    "centroid",
    [
        "gravity",
        pytest.param("weighted", marks=pytest.mark.slow),
        pytest.param("likelihood", marks=pytest.mark.slow),
    ],
)
def test_its_mean_and_variance_over_the_noise_are_exact(centroid):
    """One sky, 40 draws of the noise: mean within four sigma, chi-square within 1e-4."""
    attitude = random_attitude(Streams(5, 3))
    n = 40
    attitudes = attitude * at_random(1, range(n)) ** 0  # the same one n times
    outcomes, controls = sample_controlled(with_centroid(centroid), 6, range(n), attitudes)
    for axis in "xyz":
        assert np.ptp(controls[f"middle_{axis}"]) == 0
        variance = controls[f"variance_{axis}"][0]
        pull = (controls[f"linear_{axis}"] - controls[f"middle_{axis}"]) / np.sqrt(variance)
        assert abs(pull.mean()) < 4 / np.sqrt(n)
        assert abs(np.mean(pull**2) - 1) < 4 * np.sqrt(2 / n)
        assert np.corrcoef(controls[f"linear_{axis}"], outcomes[f"error_{axis}"])[0, 1] > 0.85
    assert abs(surplus(controls).mean()) < 4 * surplus(controls).std() / np.sqrt(n)


@pytest.mark.slow
def test_it_halves_the_trials_that_an_rms_takes():
    outcomes, controls = sample_controlled(CASE, 9, range(50), at_random(9, range(50)))
    assert outcomes["solved"].all()
    for about in (False, True):
        values = squares(outcomes, about)
        alone, helped = plain(values), controlled(values, surplus(controls, about)[:, None])
        assert (alone.error / helped.error) ** 2 > 2
        assert abs(helped.value - alone.value) < 4 * alone.error


def test_trials_are_those_of_the_chain():
    """With random attitudes, the outcomes are those of `trials`."""
    from startrack.trial.chain import run_trials

    outcomes, _ = sample_controlled(CASE, 9, range(5), at_random(9, range(5)))
    np.testing.assert_array_equal(outcomes, run_trials(CASE, 9, range(5)))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"lag": 0.1}, "without lag"),
        ({"nonlinearity": 0.05}, "without nonlinearity, adc_inl and hits"),
    ],
)
def test_detectors_whose_law_is_not_linear_are_refused(change, sentence):
    instrument = CASE.instrument
    detector = dataclasses.replace(instrument.detector, **change)
    case = dataclasses.replace(CASE, instrument=dataclasses.replace(instrument, detector=detector))
    with pytest.raises(ValueError, match=sentence):
        sample_controlled(case, 1, range(1), at_random(1, range(1)))


def test_a_sky_without_bright_stars_has_no_control():
    dark = dataclasses.replace(CASE.instrument.detector, exposure=1e-4)
    case = dataclasses.replace(CASE, instrument=dataclasses.replace(CASE.instrument, detector=dark))
    outcomes, controls = sample_controlled(case, 1, range(2), at_random(1, range(2)))
    assert not outcomes["solved"].any()
    assert surplus(controls).tolist() == [0, 0]
    assert squares(outcomes).tolist() == [0, 0]


def test_a_frame_without_any_star_has_no_control():
    """A narrow field of a sparse catalogue has nothing to linearise, and no error is raised."""
    size = CASE.instrument.detector.rows, CASE.instrument.detector.columns
    none = stars_in_field(
        Sky(open_sky(CASE.catalog).stars[:0]), random_attitude(Streams(1, 1)), CAMERA
    )
    electrons, image = np.full(size, 30.0), np.full(size, 70.0)
    assert control(CASE, random_attitude(Streams(1, 1)), none, electrons, image) is None
