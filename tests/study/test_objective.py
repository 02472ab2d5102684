import math

import numpy as np
import pytest

from startrack.study.montecarlo import OUTCOMES
from startrack.study.objective import Objective

RMS = Objective()


def outcomes(squares):
    table = np.zeros(len(squares), OUTCOMES)
    table["error_x"] = np.sqrt(squares)
    table["error_y"] = np.sqrt(squares)
    table["solved"] = np.isfinite(squares)
    return table


def test_the_interval_of_the_factor_covers():
    """100 repetitions with a true factor of 2; at most 13 misses (binomial, 1e-3)."""
    rng, misses = np.random.default_rng(0), 0
    for _ in range(100):
        best = rng.chisquare(2, 300)
        start = 4 * (0.7 * best + 0.3 * rng.chisquare(2, 300))
        interval = RMS.ratio(start, best, 1)
        misses += not interval.low < 2 < interval.high
    assert misses <= 13


def test_a_design_that_solves_nothing_has_no_factor():
    assert math.isnan(RMS.ratio(np.full(5, np.nan), np.ones(5), 1).value)


def test_statistics_of_known_errors():
    """Normal errors of 1 about x and y, 3 about z: Rayleigh's and the normal law's levels."""
    table = np.zeros(200_000, OUTCOMES)
    rng = np.random.default_rng(1)
    for axis, sigma in (("x", 1), ("y", 1), ("z", 3)):
        table[f"error_{axis}"] = rng.normal(0, sigma, len(table))
    table["solved"] = True
    level = math.sqrt(-math.log(1 - 0.9973))  # sqrt((x^2 + y^2) / 2) is Rayleigh's over sqrt 2
    for text, value in (
        ("across", 1),
        ("about", 3),
        ("both", math.sqrt(11 / 3)),
        ("across-99.73", level),
        ("about-95.45", 6),
    ):
        objective = Objective.read(text)
        assert objective.of(objective.squares(table)) == pytest.approx(value, rel=0.02)


def test_what_is_wrong_or_unsolved_does_not_count():
    table = outcomes(np.array([1.0, 4.0, 1e6, np.nan]))
    table["false"][2] = True
    assert RMS.of(RMS.squares(table)) == pytest.approx(math.sqrt(2.5))


@pytest.mark.parametrize("text", ["along", "across-", "across-0", "across-100", "about-x"])
def test_an_unknown_objective_is_refused(text):
    with pytest.raises(ValueError, match="objective must be"):
        Objective.read(text)


@pytest.mark.parametrize("text", ["across", "about", "both", "across-99.73", "about-68"])
def test_what_is_stated_is_the_statistic_of_such_errors(text):
    """Errors drawn with the stated variances, which differ by sky: within 2 % of 100,000."""
    rng = np.random.default_rng(3)
    table = np.zeros(100_000, OUTCOMES)
    sigma = np.exp(rng.normal(0, 0.5, len(table)))
    for axis in "xyz":
        table[f"sigma_{axis}"] = sigma
        table[f"error_{axis}"] = rng.normal(0, sigma)
    table["solved"] = True
    objective = Objective.read(text)
    stated = objective.stated(objective.variances(table))
    assert stated == pytest.approx(objective.of(objective.squares(table)), rel=0.02)
