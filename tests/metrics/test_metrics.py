import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from startrack.core.values import Estimate, Status
from startrack.metrics import (
    ErrorLimits,
    correct,
    fraction_interval,
    judge,
    rms_interval,
    summarise,
)
from startrack.trial.chain import OUTCOMES

TRUTH = Rotation.from_rotvec([0.3, -1.0, 2.0])


def estimate(error, sigma=1e-5):
    attitude = Rotation.from_rotvec(error) * TRUTH
    return Estimate(Status.SOLVED, "", attitude, np.eye(3) * sigma**2, 0.1, 9, 1e-9)


def test_the_error_is_in_camera_axes():
    """A rotation about the boresight is the z error at any attitude."""
    outcome = judge(estimate([0, 0, 2e-5]), TRUTH, 12)
    assert outcome.error_z == pytest.approx(2e-5, rel=1e-9)
    assert abs(outcome.error_x) < 1e-15
    assert outcome.nees == pytest.approx(4, rel=1e-9)
    assert (outcome.solved, outcome.false, outcome.stars, outcome.spots) == (True, False, 9, 12)


def test_an_error_of_180_deg_is_false_and_finite():
    outcome = judge(estimate([np.pi, 0, 0]), TRUTH, 3)
    assert outcome.false
    assert np.isfinite(outcome.nees)


def test_unsolved_is_neither_correct_nor_false():
    none = Estimate(Status.NO_MATCH, "", None, np.full((3, 3), np.nan), np.nan, 0, 1.0)
    outcome = judge(none, TRUTH, 4)
    assert (outcome.solved, outcome.false) == (False, False)
    assert np.isnan(outcome.error_x)


def outcomes(rows):
    table = np.zeros(len(rows), OUTCOMES)
    for line, (x, y, z, solved, false) in zip(table, rows, strict=True):
        line["error_x"], line["error_y"], line["error_z"] = x, y, z
        line["solved"], line["false"] = solved, false
        line["sigma_x"] = line["sigma_y"] = line["sigma_z"] = 2.0
    return table


TRIALS = [(3, 4, 1, 1, 0), (3, 4, 7, 1, 0), (99, 99, 99, 1, 1), (np.nan,) * 3 + (0, 0)]


def test_an_attitude_is_right_within_what_is_required_or_stated():
    """Errors of 5 across, and of 1 and 7 about; the stated error is 2 about each axis."""
    table = outcomes(TRIALS)
    for limits, found in (
        (ErrorLimits(), [1, 1, 0, 0]),
        (ErrorLimits(across=4.9), [0, 0, 0, 0]),
        (ErrorLimits(across=5.1), [1, 1, 0, 0]),
        (ErrorLimits(across=5.1, about=6.9), [1, 0, 0, 0]),
        (ErrorLimits(across=1e9, about=1e9), [1, 1, 0, 0]),
    ):
        assert correct(table, limits).tolist() == [bool(one) for one in found]
    for axis in "xyz":
        table[f"sigma_{axis}"] = 0.99  # of which 5 is more than five
    assert not correct(table).any()
    assert correct(table, ErrorLimits(5.1, 7.1)).tolist() == [True, True, False, False]


def test_inaccurate_attitudes_count_in_the_errors_and_not_in_the_availability():
    summary = summarise(outcomes(TRIALS), ErrorLimits(about=6.9))
    assert summary.about.value == pytest.approx(5)
    assert (summary.availability.value, summary.inaccurate.value) == (0.25, 0.25)
    assert summary.false.value == 0.25


def test_summary_takes_correct_attitudes_alone():
    summary = summarise(outcomes(TRIALS))
    assert summary.across.value == pytest.approx(np.sqrt(12.5))
    assert summary.about.value == pytest.approx(5)
    assert summary.availability.value == 0.5
    assert summary.false.value == 0.25


def test_summary_without_a_correct_attitude():
    summary = summarise(outcomes([(np.nan,) * 3 + (0, 0)] * 3))
    assert np.isnan(summary.across.value)
    assert summary.availability.value == 0
    assert summary.availability.high == pytest.approx(1 - 0.025 ** (1 / 3))


@pytest.mark.parametrize("spread", [0.0, 0.5], ids=["normal", "of a sky"])
@pytest.mark.parametrize("trials", [20, 50, 200, 1000])
@pytest.mark.parametrize("axes", [1, 2])
def test_rms_intervals_cover(trials, spread, axes):
    """2,000 repetitions of errors whose sigma varies over the sky; binomial bounds of 1e-4.

    The true coverage may lie between 0.93 and 0.97, and each side may miss 5.5 %.
    """
    rng = np.random.default_rng((trials, axes))
    sigma = np.exp(spread * rng.standard_normal((2000, trials)))
    squares = sigma**2 * rng.chisquare(axes, (2000, trials)) / axes
    truth = np.exp(spread**2)
    intervals = [rms_interval(row) for row in squares]
    below = sum(interval.high < truth for interval in intervals)
    above = sum(interval.low > truth for interval in intervals)
    assert below + above <= stats.binom.isf(1e-4, 2000, 0.07)
    assert below + above >= stats.binom.ppf(1e-4, 2000, 0.03)
    assert max(below, above) <= stats.binom.isf(1e-4, 2000, 0.055)


def test_two_errors_bound_no_rms():
    assert (rms_interval(np.ones(2)).low, rms_interval(np.ones(2)).high) == (0, np.inf)


def test_few_uneven_errors_have_an_open_end():
    """Four errors, of which one decides, bound no rms: 95 % by a model would be 6e7 of them."""
    assert rms_interval(np.array([0.01, 0.02, 0.01, 4.0])).high == np.inf
    assert rms_interval(np.array([1.1, 0.9, 1.2, 0.8])).high < 2


def test_fraction_intervals_cover():
    """Exact intervals cover at least 95 %; 1e-4 below that is a false alarm."""
    hits = 0
    for count in np.random.default_rng(1).binomial(100, 0.97, 1000):
        interval = fraction_interval(int(count), 100)
        hits += interval.low <= 0.97 <= interval.high
    assert hits >= stats.binom.ppf(1e-4, 1000, 0.95)


def campaign(nees, error=1.0, trials=50):
    """Trials with a stated sigma of 1 about each axis."""
    table = outcomes([(error, 0, 0, 1, 0)] * trials)
    table["sigma_x"] = table["sigma_y"] = table["sigma_z"] = 1.0
    table["nees"] = nees
    return summarise(table)


def test_a_covariance_is_doubted_where_its_errors_are_not_those_stated():
    assert not campaign(3.0).doubt
    assert "squared is 5.1" in campaign(5.1).doubt
    assert "squared is 1.2" in campaign(1.2).doubt
    assert not campaign(5.1, trials=2).doubt  # chance: one of six such pairs has more
    assert campaign(3.0, error=11.0).doubt == (
        "covariance not trustworthy: 50 of 50 attitudes are off by more than ten of their stated "
        "sigma"
    )
    assert not summarise(outcomes([(np.nan,) * 3 + (0, 0)] * 3)).doubt
