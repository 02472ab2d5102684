import math

import numpy as np
import pytest
from scipy import stats

from startrack.montecarlo.resume import FIRST_TEST, Precision, half_width, quantile_interval

REPETITIONS = 400


@pytest.mark.parametrize(("fraction", "n"), [(0.5, 25), (0.9, 200), (0.9973, 3000)])
def test_quantile_intervals_hold_what_they_state(fraction, n):
    """For Rayleigh errors; the interval is conservative: at least 95 %, one-sided bound at 1e-4."""
    truth = stats.rayleigh.ppf(fraction)
    rng = np.random.default_rng(11)
    hits = 0
    for _ in range(REPETITIONS):
        interval = quantile_interval(rng.rayleigh(size=n), fraction)
        assert interval.low <= interval.value <= interval.high
        hits += interval.low <= truth <= interval.high
    assert hits >= stats.binom.ppf(1e-4, REPETITIONS, 0.95)


def test_the_median_of_ten_lies_between_the_second_and_ninth():
    """David and Nagaraja's table for n = 10: [X_2, X_9] has 97.9 %, [X_3, X_8] only 89 %."""
    interval = quantile_interval(np.arange(1.0, 11.0)[::-1], 0.5)
    assert (interval.low, interval.value, interval.high) == (2, 5, 9)


def test_too_few_values_leave_the_interval_open():
    assert quantile_interval(np.arange(100.0), 0.9973).high == math.inf
    assert math.isnan(quantile_interval(np.array([]), 0.5).value)


@pytest.mark.parametrize(("statistic", "most"), [("across", 4000), ("across-99.73", 40_000)])
def test_stopping_keeps_the_coverage(outcomes, statistic, most):
    """Campaigns that stop early still have the stated coverage (1e-4)."""
    precision = Precision(0.05, statistic, 0.95)
    truth = 1e-5 * (1 if statistic == "across" else stats.rayleigh.ppf(0.9973))
    hits, sizes = 0, []
    for seed in range(80):
        table = outcomes(most, seed)
        n = FIRST_TEST
        while not precision.reached(table[:n]):
            n = min(precision.next_size(table[:n], n), len(table))
        interval = precision.interval(table[:n])
        sizes.append(n)
        assert half_width(interval) <= precision.relative
        hits += interval.low <= truth <= interval.high
    assert hits >= stats.binom.ppf(1e-4, 80, 0.95)
    if statistic == "across":
        # Each trial has two squares of a normal law: half-width z / (2 sqrt(n)).
        assert np.median(sizes) == pytest.approx((1.96 / (2 * 0.05)) ** 2, rel=0.3)


def test_availability_counts_false_attitudes_as_lost(outcomes):
    table = outcomes(1000)
    table["solved"][:20] = False
    table["false"][20:30] = True
    for axis in "xyz":
        table[f"sigma_{axis}"] = 1e-5
    interval = Precision(0.01, "availability").interval(table)
    assert interval.value == pytest.approx(0.97)
    assert interval.low < 0.97 < interval.high


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((0.0,), "relative must lie in"),
        ((0.1, "median"), "statistic must be one of across, about, availability, across-99.73"),
        ((0.1, "across", 1.0), "confidence must lie in"),
    ],
)
def test_wrong_precisions_are_refused(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        Precision(*arguments)
