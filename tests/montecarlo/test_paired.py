import numpy as np
import pytest
from scipy import stats

from startrack.metrics import ErrorLimits, ratio_of_levels, trials_for_level
from startrack.montecarlo import differences

EVERYTHING = (ErrorLimits(1.0, 1.0),) * 2


def test_a_paired_ratio_is_known_better_than_either(outcomes):
    """The second adds noise of 30 % to the same errors; 200 repetitions cover in 95 %, 1e-3."""
    missed, widths, rng = 0, [], np.random.default_rng(1)
    for seed in range(200):
        first = outcomes(100, seed)
        second = first.copy()
        for axis in "xyz":
            second[f"error_{axis}"] += 0.3e-5 * rng.standard_normal(100)
        across = differences(first, second, EVERYTHING)[0]
        missed += not across.change.low <= np.sqrt(1.09) <= across.change.high
        widths.append(across.change.high - across.change.low)
    apart = differences(first, outcomes(100, 1000), EVERYTHING, paired=False)[0]
    assert missed <= stats.binom.isf(1e-3, 200, 0.05)
    assert np.mean(widths) < 0.5 * (apart.change.high - apart.change.low)


def test_a_level_that_trials_cannot_bound_has_no_bounds(outcomes):
    """0.9973^1365 is the first power below 0.025."""
    few = differences(outcomes(200, 1), outcomes(200, 2), EVERYTHING, paired=False)[2]
    assert (few.change.low, few.change.high) == (0, np.inf)
    assert trials_for_level(0.9973) == 1365
    many = differences(outcomes(1400, 1), outcomes(1400, 2), EVERYTHING, paired=False)[2]
    assert 0 < many.change.low < many.change.high < np.inf


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_the_ratio_of_levels_covers(correlation):
    """Of 1,500 trials of each, 400 repetitions; the true ratio is 2, 1e-3."""
    rng, missed = np.random.default_rng(2), 0
    for _ in range(400):
        z = rng.standard_normal((2, 1500))
        first = 4 * z[0] ** 2
        second = (correlation * z[0] + np.sqrt(1 - correlation**2) * z[1]) ** 2
        interval = ratio_of_levels([first], [second], 0.95, [1.0], paired=correlation > 0)
        missed += not interval.low < 2 < interval.high
    assert missed <= stats.binom.isf(1e-3, 400, 0.07)


def test_availability_counts_what_one_alone_solved(outcomes):
    """20 of 1000 gained and 5 lost: 1.5 %, whose standard error is 0.5 %."""
    first, second = outcomes(1000), outcomes(1000)
    first["solved"][:20] = False
    second["solved"][20:25] = False
    found = differences(first, second, EVERYTHING)[-1]
    assert found.change.value == pytest.approx(0.015)
    assert (found.change.high - found.change.low) / 3.92 == pytest.approx(0.005, rel=0.05)
    apart = differences(first, second, EVERYTHING, paired=False)[-1]
    assert apart.change.low < found.change.low


def test_nothing_solved_has_no_difference(outcomes):
    first = outcomes(5)
    first["solved"] = False
    assert np.isnan(differences(first, first, EVERYTHING)[0].change.value)
