import numpy as np
import pytest
from scipy import stats

from startrack.metrics import Limits
from startrack.montecarlo import differences

EVERYTHING = (Limits(1.0, 1.0),) * 2


def test_a_paired_difference_is_known_better_than_either(outcomes):
    """The second adds 10 % to the same errors; 15 repetitions cover it in 95 %, 1e-3."""
    missed, widths = 0, []
    for seed in range(15):
        first = outcomes(100, seed)
        second = first.copy()
        for axis in "xyz":
            second[f"error_{axis}"] *= 1.1
        across = differences(first, second, 1, EVERYTHING)[0]
        missed += not across.change.low <= 0.1 * 1e-5 <= across.change.high
        widths.append(across.change.high - across.change.low)
    apart = differences(first, outcomes(100, 1000), 1, EVERYTHING, paired=False)[0]
    assert missed <= stats.binom.isf(1e-3, 15, 0.08)  # percentiles of 100 trials cover less
    assert np.mean(widths) < 0.3 * (apart.change.high - apart.change.low)


def test_availability_counts_what_one_alone_solved(outcomes):
    """20 of 1000 gained and 5 lost: 1.5 %, whose standard error is 0.5 %."""
    first, second = outcomes(1000), outcomes(1000)
    first["solved"][:20] = False
    second["solved"][20:25] = False
    found = differences(first, second, 1, EVERYTHING)[-1]
    assert found.change.value == pytest.approx(0.015)
    assert (found.change.high - found.change.low) / 3.92 == pytest.approx(0.005, rel=0.05)
    apart = differences(first, second, 1, EVERYTHING, paired=False)[-1]
    assert apart.change.low < found.change.low


def test_nothing_solved_has_no_difference(outcomes):
    first = outcomes(5)
    first["solved"] = False
    assert np.isnan(differences(first, first, 1, EVERYTHING)[0].change.value)
