"""Drawn spots that are identified, against rendered ones and against perfect identification."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from startrack.catalog import open_sky
from startrack.core import Curve
from startrack.core.streams import Streams
from startrack.design.case import Fidelity
from startrack.observation.pointing import random_attitude
from startrack.observation.stars import electrons_of
from startrack.trial import chain
from startrack.trial.chain import run_random_trial, run_trials
from startrack.trial.spot_plan import plan_spots
from startrack.trial.spots import spots_of
from startrack.trial.window import spots_in_windows

from .designs import CASE, marginal

FEW = 2.5e-3  # second: five stars, and some of noise


def drawn(case, number, seed=4):
    streams = Streams(seed, number)
    return spots_of(case, random_attitude(streams), streams)


def counts(outcomes):
    """Number of trials with and without a correct attitude."""
    right = int((outcomes["solved"] & ~outcomes["false"]).sum())
    return right, len(outcomes) - right


def test_a_trial_that_is_identified_has_the_spots_of_one_whose_matches_are_known():
    known = run_trials(CASE, 4, range(20), Fidelity.COVARIANCE)
    found = run_trials(CASE, 4, range(20), Fidelity.SPOTS)
    np.testing.assert_array_equal(found["spots"], known["spots"])
    # The same noise; stars that one of the two leaves out, and weights by both axes, are the rest.
    same = found["stars"] == known["stars"]
    assert same.sum() > 3
    off = np.abs(found["error_x"] - known["error_x"])
    assert np.median(off[same]) < 0.1 * known["sigma_x"].mean()
    assert off.max() < known["sigma_x"].max()


def test_spots_are_those_of_windows_in_brightness_and_doubt():
    """Each bright spot has a counterpart; the brightest are left out, because they may saturate.

    Differences over their sigma are normal by a test of Kolmogorov and Smirnov, 1 false in 1000.
    """
    bright, apart, doubt = np.arange(2, 12), [], []
    for number in range(8):
        streams = Streams(4, number)
        attitude = random_attitude(streams)
        one, other = spots_of(CASE, attitude, streams), spots_in_windows(CASE, attitude, streams)
        away = np.hypot(one.x[bright, None] - other.x, one.y[bright, None] - other.y)
        fellow = away.argmin(axis=1)
        assert away.min(axis=1).max() < 1.0
        sigma = np.hypot(one.flux[bright] / one.snr[bright], other.flux[fellow] / other.snr[fellow])
        apart.extend((one.flux[bright] - other.flux[fellow]) / sigma)
        doubt.extend(np.trace(one.covariance[bright].T) / np.trace(other.covariance[fellow].T))
    assert stats.kstest(apart, "norm").pvalue > 1e-3
    assert np.median(doubt) == pytest.approx(1, abs=0.05)


def test_faint_stars_are_missed_as_often_as_in_windows():
    """Stars that noise hides, and those that it makes look like hot pixels: one in eight of some
    130 electrons.

    4 standard deviations of the difference between 120 trials each.
    """
    case = marginal(0.013)
    camera, sky = case.believed_camera, open_sky(case.catalog).stars
    electrons = electrons_of(case)
    faint = np.flatnonzero((electrons > 105) & (electrons < 156))
    found = {spots_of: [], spots_in_windows: []}
    for number in range(120):
        streams = Streams(41, number)
        attitude = random_attitude(streams)
        place = camera.project(attitude.apply(sky.direction[faint]))
        place = place[camera.holds(place, -4)]
        for make, fractions in found.items():
            spots = make(case, attitude, streams)
            away = np.hypot(place[:, :1] - spots.x, place[:, 1:] - spots.y)
            fractions.extend(away.min(axis=1) < 2)
    drawn_share, fraction = (np.mean(each) for each in found.values())
    assert 0.8 < fraction < 0.95
    assert abs(drawn_share - fraction) < 4 * np.sqrt(
        2 * fraction * (1 - fraction) / len(found[spots_of])
    )


def test_spots_are_brightest_first_and_no_more_than_the_tracker_keeps():
    detection = dataclasses.replace(CASE.tracker.detection, max_spots=7)
    few = dataclasses.replace(CASE, tracker=dataclasses.replace(CASE.tracker, detection=detection))
    everything, kept = drawn(CASE, 0), drawn(few, 0)
    assert len(kept) == 7
    assert (np.diff(everything.flux) <= 0).all()
    np.testing.assert_array_equal(kept.flux, everything.flux[:7])


def test_noise_alone_makes_as_many_spots_as_are_told_and_strews_them():
    """A Poisson count within 4 standard deviations; uniform places by Kolmogorov and Smirnov,
    1e-3."""
    blind = Curve((300e-9, 1200e-9), (1e-9, 1e-9))
    case = marginal(FEW)
    detector = dataclasses.replace(case.instrument.detector, quantum_efficiency=blind)
    instrument = dataclasses.replace(case.instrument, detector=detector)
    case = dataclasses.replace(case, instrument=instrument)
    made = [drawn(case, number) for number in range(1000)]
    mean = plan_spots(case).false
    total = sum(len(each) for each in made)
    assert total > 50
    assert abs(total - 1000 * mean) < 4 * np.sqrt(1000 * mean)
    for axis in ("x", "y"):
        place = np.concatenate([getattr(each, axis) for each in made])
        assert stats.kstest(place, "uniform", (1.5, 252)).pvalue > 1e-3


def test_as_many_are_right_as_of_rendered_trials():
    """100 trials of each, with different seeds; Fisher's test fails by chance once in 1000 runs."""
    one, other = (
        counts(run_trials(marginal(FEW), seed, range(100), fidelity))
        for seed, fidelity in ((7, Fidelity.WINDOW), (8, Fidelity.SPOTS))
    )
    assert 13 < one[0] < 87
    assert stats.fisher_exact([one, other])[1] > 1e-3
    # And where the matches are taken as known, more are solved than can be identified.
    known = counts(run_trials(marginal(FEW), 8, range(100), Fidelity.COVARIANCE))
    assert known[0] > other[0] + 10


def test_an_attitude_of_other_stars_counts_as_wrong(monkeypatch):
    """Spots of another sky are identified, and the attitude is wrong."""

    def elsewhere(case, _, streams):
        return spots_of(case, random_attitude(Streams(99, 0)), streams)

    monkeypatch.setattr(chain, "spots_of", elsewhere)
    outcome = run_random_trial(CASE, 4, 0, Fidelity.SPOTS)
    assert outcome.solved
    assert outcome.false


@pytest.mark.slow
def test_as_many_are_right_as_of_many_rendered_trials():
    """As above with 3000 of each, by chi-square."""
    table = [
        counts(run_trials(marginal(FEW), seed, range(3000), fidelity))
        for seed, fidelity in ((7, Fidelity.WINDOW), (8, Fidelity.SPOTS))
    ]
    assert stats.chi2_contingency(table).pvalue > 1e-3


def test_nominal_designs_are_always_identified():
    outcomes = run_trials(CASE, 4, range(50), Fidelity.SPOTS)
    assert outcomes["solved"].all()
    assert not outcomes["false"].any()
