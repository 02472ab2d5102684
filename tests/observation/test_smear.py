"""A tracker that knows its rates measures streaks; the budget and its covariance include this."""

import dataclasses

import numpy as np
import pytest

from startrack.budget import analytic
from startrack.core.units import deg
from startrack.design.case import Fidelity
from startrack.metrics import summarise
from startrack.motion import Motion
from startrack.observation import detection_plan, with_smear
from startrack.trial import run_trials
from tests.trial.designs import CASE, changed


def slewing(rate_x, rate_y=0.0, **tracker):
    case = changed(motion=Motion(rate_x=rate_x * deg, rate_y=rate_y * deg))
    return dataclasses.replace(case, tracker=dataclasses.replace(case.tracker, **tracker))


def test_the_smear_is_that_of_the_rates_that_the_tracker_knows():
    """2 deg / s for 80 ms over 35 mm / 11 um; the believed motion counts, not the true one."""
    length = 2 * deg * 0.08 * 35e-3 / 11e-6
    x, y = detection_plan(slewing(2.0)).settings.smear
    assert (x, abs(y)) == (0.0, pytest.approx(length))
    x, y = detection_plan(slewing(0.0, motion=Motion(rate_y=2 * deg))).settings.smear
    assert (abs(x), y) == (pytest.approx(length), 0.0)
    still = dataclasses.replace(CASE.tracker.detection, smear_x=0.0, smear_y=0.0)
    assert detection_plan(slewing(2.0, detection=still)).settings == still
    assert detection_plan(CASE).settings == CASE.tracker.detection  # 0.3 pixel: too short
    fitted = dataclasses.replace(CASE.tracker.detection, centroid="likelihood")
    x, y = detection_plan(slewing(0.2, 0.1, detection=fitted)).settings.smear
    assert (abs(x), abs(y)) == (pytest.approx(length / 20), pytest.approx(length / 10))


def test_a_smear_beyond_the_longest_streak_is_the_longest():
    """Of 2,000 rates, the rounded smear of some would exceed it by one bit."""
    for x in np.linspace(101.0, 1e7, 2000):
        settings = with_smear(CASE.tracker.detection, x, -x / 3)
        assert (settings.smear_x, settings.smear_y) == pytest.approx((100.0, -100 / 3))


def test_a_likelihood_of_sharp_stars_does_not_leap_where_others_give_way_to_it():
    """Smears of 0.98 and 1.02 pixel for stars of 0.33 pixel; an unknown smear has 3.7 times the
    error."""
    optics = dataclasses.replace(CASE.instrument.optics, blur=2e-6)
    detection = dataclasses.replace(CASE.tracker.detection, centroid="likelihood")
    tracker = dataclasses.replace(CASE.tracker, detection=detection)

    def error(length):
        rate = length * 11e-6 / 35e-3 / 0.08
        case = changed(optics=optics, motion=Motion(rate_x=rate))
        return analytic(dataclasses.replace(case, tracker=tracker)).across

    assert error(0.98) == pytest.approx(error(1.02), rel=0.05)


def test_a_diagonal_streak_is_drawn_as_the_stars_move():
    """The tracker's star model and a rendered star agree in the direction of the streak."""
    from startrack.response.star_response import star_images

    case = slewing(1.5, 1.0)
    image = star_images(case.instrument, np.zeros((1, 2)), 41)[0]
    table = detection_plan(case).star.psf.table
    for one in (image, table):
        middle = (len(one) - 1) / 2
        y, x = np.indices(one.shape) - middle
        assert (one * x * y).sum() / one.sum() < -0.1 * (one * x * x).sum() / one.sum()


def test_at_2_deg_per_s_budget_and_covariance_hold():
    """100 windows measure the rms to 7 % and the normalised error squared to 0.25: 2 sigma."""
    case = slewing(2.0)
    outcomes = run_trials(case, 3, range(100), Fidelity.WINDOW)
    summary = summarise(outcomes)
    assert summary.availability.value > 0.98
    assert analytic(case).across == pytest.approx(summary.across.value, rel=0.15)
    assert 2.5 < summary.nees < 3.5
    assert not summary.doubt
