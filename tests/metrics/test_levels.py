import math
from functools import cache

import numpy as np
import pytest
from scipy import stats

from startrack.metrics import (
    LEVELS,
    Interpretation,
    indices,
    level,
    level_interval,
    reproducibility,
)


def test_levels_of_normal_errors_are_one_two_and_three_sigma():
    error = np.random.default_rng(1).standard_normal(100_000)
    for fraction, sigmas in zip(LEVELS, (0.99446, 2.0, 3.0), strict=True):
        got = level_interval(error, fraction)
        assert got.low < sigmas < got.high
        assert got.value == pytest.approx(sigmas, rel=0.02)


@cache
def heavy_tails(count):
    return np.random.default_rng(count).standard_t(3, (1500, count))


@pytest.mark.parametrize("fraction", [0.68, 0.9545, 0.9973])
@pytest.mark.parametrize("count", [40, 300, 1000])
def test_intervals_cover_for_any_distribution(fraction, count):
    """Heavy tails, 1500 repetitions; 95 % or more, 1e-4 of false alarm."""
    truth = stats.t(3).ppf((1 + fraction) / 2)
    hits = 0
    for errors in heavy_tails(count):
        interval = level_interval(errors, fraction)
        hits += interval.low <= truth <= interval.high
    assert hits >= stats.binom.ppf(1e-4, 1500, 0.95)


def test_too_few_errors_have_no_upper_bound():
    assert level_interval(np.ones(30), 0.9973).high == math.inf


def test_interpretations():
    """Ten trackers, each with a constant bias of a different size, one of them ten times as
    large."""
    error = np.ones((10, 400))
    error[3] = -10.0
    assert level(error, 0.8, Interpretation.TEMPORAL) == 10
    assert level(error, 0.8, Interpretation.ENSEMBLE) == 1
    assert level(error, 0.8, Interpretation.MIXED) == 1
    assert level(error.T, 0.8, Interpretation.TEMPORAL) == 1
    assert level(error.T, 0.8, Interpretation.ENSEMBLE) == 10


def test_indices_of_a_bias_with_a_drift():
    """A drift of slope s: s T / sqrt(12) rms within a window and s T between neighbours."""
    time = (np.arange(10_000) + 0.5) * 0.01
    error = np.outer(2.0 + 0.3 * time, [1.0, -1.0, 0.0])
    got = indices(error, 0.01, 10.0)
    assert got.mean.shape == (10, 3)
    np.testing.assert_allclose(got.mean[0], [2 + 0.3 * 5, -3.5, 0], rtol=1e-9)
    rms = np.sqrt((got.relative**2).mean(axis=0))
    np.testing.assert_allclose(rms, [3 / math.sqrt(12), 3 / math.sqrt(12), 0], rtol=1e-5)
    np.testing.assert_allclose(got.drift, np.tile([3.0, -3.0, 0], (9, 1)), rtol=1e-9)
    np.testing.assert_allclose(indices(error, 0.01, 10.0, lag=4).drift[:, 0], 12.0, rtol=1e-9)


def test_a_whole_period_has_no_mean_and_all_of_its_size():
    error = np.sin(2 * np.pi * np.arange(1000) / 100)
    got = indices(error, 1.0, 100.0)
    assert np.abs(got.mean).max() < 1e-14
    assert np.sqrt((got.relative**2).mean()) == pytest.approx(1 / math.sqrt(2))


def test_white_noise_is_averaged_over_the_window():
    error = np.random.default_rng(0).standard_normal(400_000)
    got = indices(error, 1.0, 100.0)
    assert got.mean.std() == pytest.approx(0.1, rel=0.06)
    assert got.relative.std() == pytest.approx(math.sqrt(0.99), rel=0.005)


def test_errors_after_the_last_window_are_in_the_absolute_error_alone():
    got = indices(np.arange(25.0), 1.0, 10.0)
    assert (len(got.absolute), len(got.mean), len(got.relative), len(got.drift)) == (25, 2, 20, 1)


def test_reproducibility_is_the_change_of_the_mean():
    first, second = np.full((50, 3), 1.0), np.full((80, 3), 4.0)
    np.testing.assert_array_equal(reproducibility(first, second), [3, 3, 3])


def test_wrong_input_is_refused():
    with pytest.raises(ValueError, match="window must last from one step"):
        indices(np.zeros(10), 1.0, 11.0)
    with pytest.raises(ValueError, match="step must be positive, got 0"):
        indices(np.zeros(10), 0.0, 1.0)
    with pytest.raises(ValueError, match="lag must be at least one window"):
        indices(np.zeros(10), 1.0, 2.0, lag=0)
    with pytest.raises(ValueError, match=r"must lie in \(0, 1\), got 1.0"):
        level(np.zeros((1, 3)), 1.0, Interpretation.MIXED)
    with pytest.raises(ValueError, match="members and times"):
        level(np.zeros(3), 0.5, Interpretation.MIXED)
