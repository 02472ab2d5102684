"""Each estimate is unbiased, and its interval has the stated coverage."""

import numpy as np
import pytest
from scipy import stats

from startrack.montecarlo.estimate import Mean, controlled, plain, replicated, two_levels

REPETITIONS = 400
RHO = 0.95


def by_plain(rng):
    return plain(rng.exponential(size=300)), 1.0


def by_control(rng):
    """Squares of two normal numbers, one the control of the other: skewed, as squared errors
    are."""
    x = rng.standard_normal(300)
    y = RHO * x + np.sqrt(1 - RHO**2) * rng.standard_normal(300)
    return controlled(y**2, (x**2 - 1)[:, None]), 1.0


def by_replicates(rng):
    """Values of a replicate are correlated; only replicates are independent."""
    replicate = np.arange(320) % 16
    shift = rng.standard_normal(16)
    return replicated(2 + shift[replicate] + 0.1 * rng.standard_normal(320), replicate), 2.0


def by_levels(rng):
    x = rng.standard_normal(2000)
    fine = RHO * x[:100] + np.sqrt(1 - RHO**2) * rng.standard_normal(100)
    return two_levels(3 + fine, 1 + x[:100], plain(1 + x[100:])), 3.0


ALL = [by_plain, by_control, by_replicates, by_levels]


@pytest.mark.parametrize("estimate", ALL)
def test_unbiased_and_covered(estimate):
    """400 repetitions: mean within four standard errors, 95 % coverage above its bound at 1e-4.

    Intervals of a few hundred skewed squares cover less: three points are allowed.
    """
    rng = np.random.default_rng(8)
    values, hits = [], 0
    for _ in range(REPETITIONS):
        mean, truth = estimate(rng)
        interval = mean.interval()
        values.append(mean.value)
        hits += interval.low <= truth <= interval.high
    scatter = np.std(values) / np.sqrt(REPETITIONS)
    assert abs(np.mean(values) - truth) < 4 * scatter
    assert stats.binom.ppf(1e-4, REPETITIONS, 0.92) <= hits


@pytest.mark.parametrize(("estimate", "gain"), [(by_control, 3.0), (by_levels, 6.0)])
def test_help_is_worth_so_much(estimate, gain):
    """Variance of plain means over that with variance reduction, equal to the ratio of stated
    errors.

    Control: squares correlate by rho^2, 1 / (1 - rho^4) = 5.4. Strata: 1 + 8.25 = 9.25. Levels: 1 /
    (1 - rho^2 + rho^2 / 19) = 6.9.
    """
    rng = np.random.default_rng(9)
    means = [estimate(rng)[0] for _ in range(REPETITIONS)]
    scatter = np.std([mean.value for mean in means])
    stated = np.sqrt(np.mean([mean.error**2 for mean in means]))
    assert stated == pytest.approx(scatter, rel=0.15)
    alone = {by_control: np.sqrt(2 / 300), by_levels: 0.1}
    assert (alone[estimate] / scatter) ** 2 > gain


def test_a_control_that_says_nothing_costs_next_to_nothing():
    rng = np.random.default_rng(3)
    values, noise = rng.standard_normal(1000), rng.standard_normal((1000, 3))
    assert controlled(values, noise).error == pytest.approx(plain(values).error, rel=0.02)


def test_the_root_of_a_mean_square_is_an_rms():
    rms = plain(np.array([1.0, 2.0, 3.0, 2.0])).root()
    assert rms.value == pytest.approx(2**0.5)
    assert 0 < rms.low < rms.value < rms.high


def test_a_mean_square_below_zero_has_a_root_of_zero():
    """A control may give such a mean for few values that are nearly zero."""
    rms = Mean(-1.0, 2.0, 9.0).root()
    assert (rms.low, rms.value) == (0, 0)
    assert rms.high == pytest.approx((2 * stats.t.ppf(0.975, 9) - 1) ** 0.5)


def test_too_few_values_are_refused():
    with pytest.raises(ValueError, match="equally many"):
        replicated(np.arange(3.0), np.array([0, 0, 1]))
