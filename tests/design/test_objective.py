import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from startrack.budget import Budget, BudgetLine, ErrorLaw
from startrack.design.objective import Objective
from startrack.trial.chain import OUTCOMES
from startrack.verification import expected_error

RMS = Objective()


def outcomes(squares):
    table = np.zeros(len(squares), OUTCOMES)
    table["error_x"] = np.sqrt(squares)
    table["error_y"] = np.sqrt(squares)
    table["solved"] = np.isfinite(squares)
    return table


@pytest.mark.parametrize("trials", [20, 50, 200])
@pytest.mark.parametrize("paired", [True, False])
def test_the_interval_of_the_factor_covers(trials, paired):
    """The true factor is 2; in 1,000 repetitions the coverage may lie from 0.93 to 0.97 (1e-4)."""
    rng, misses = np.random.default_rng(trials), 0
    for _ in range(1000):
        best = rng.chisquare(2, trials)
        other = rng.chisquare(2, trials)
        start = 4 * (0.7 * best + 0.3 * other if paired else other)
        interval = RMS.ratio([start], [best], paired=paired)
        misses += not interval.low < 2 < interval.high
    assert stats.binom.ppf(1e-4, 1000, 0.03) <= misses <= stats.binom.isf(1e-4, 1000, 0.07)


def test_a_design_that_solves_nothing_has_no_factor():
    assert math.isnan(RMS.ratio([np.full(5, np.nan)], [np.ones(5)]).value)


def test_statistics_of_known_errors():
    """Normal errors of 1 about x and y and 3 about z have the levels of Rayleigh's and the
    normal law."""
    table = np.zeros(200_000, OUTCOMES)
    rng = np.random.default_rng(1)
    for axis, sigma in (("x", 1), ("y", 1), ("z", 3)):
        table[f"error_{axis}"] = rng.normal(0, sigma, len(table))
    table["solved"] = True
    level = math.sqrt(-2 * math.log(1 - 0.9973))  # Rayleigh's
    for text, value in (
        ("across", 1),
        ("about", 3),
        ("both", math.sqrt(11 / 3)),
        ("across-99.73", level),
        ("about-95.45", 6),
        ("both radial", math.sqrt(11)),  # the root of the sum of the squares over the axes
        ("across + about", 4),
        ("0.5 about + across", 2.5),
    ):
        objective = Objective.read(text)
        assert objective.of(objective.squares(table)) == pytest.approx(value, rel=0.02)


def test_what_is_wrong_or_unsolved_does_not_count():
    table = outcomes(np.array([1.0, 4.0, 1e6, np.nan]))
    table["false"][2] = True
    assert RMS.of(RMS.squares(table)) == pytest.approx(math.sqrt(2.5))


@pytest.mark.parametrize(
    "text",
    [
        *("along", "across-", "across-0", "across-100", "about-x", "across +"),
        *("across + along", "across + 0 about", "across + -1 about", "about-99 + across"),
    ],
)
def test_an_unknown_objective_is_refused(text):
    with pytest.raises(ValueError, match="objective must be"):
        Objective.read(text)


def test_no_axes_are_added_twice():
    with pytest.raises(ValueError, match="must not add the same axes twice"):
        Objective.read("across + 2 across")


def test_means_over_conditions_are_those_of_their_names():
    errors, weights = [1.0, 4.0, 2.0], [1.0, 2.0, 1.0]
    for mean, value in (
        ("geometric", 2**1.25),
        ("arithmetic", 11 / 4),
        ("quadratic", math.sqrt(37 / 4)),
        ("worst", 4.0),
    ):
        objective = Objective(mean=mean)
        assert objective.over(errors, weights) == pytest.approx(value, rel=1e-12)
        assert math.isnan(objective.over([1.0, math.nan], weights[:2]))
        assert objective.over([3.0], [2.0]) == 3.0


@pytest.mark.parametrize(
    ("paired", "trials"),
    [
        (True, 20),
        (False, 200),
        pytest.param(True, 200, marks=pytest.mark.slow),
        pytest.param(False, 20, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize(
    ("text", "mean"),
    [("across + 0.3 about", "geometric"), ("across", "arithmetic"), ("across", "quadratic")],
)
def test_the_interval_of_the_factor_of_sums_and_means_covers(text, mean, trials, paired):
    """Two conditions of errors 1 and 3 across, thrice that about, against half of that.

    600 repetitions; the coverage may lie from 0.93 to 0.97, with a false alarm of 1e-4.
    """
    objective = dataclasses.replace(Objective.read(text), mean=mean)
    rng, misses = np.random.default_rng(trials), 0

    def drawn(size, noise):
        table = np.zeros(trials, OUTCOMES)
        table["solved"] = True
        for axis, sigma, error in zip("xyz", (1, 1, 3), noise, strict=True):
            table[f"error_{axis}"] = size * sigma * error
        return objective.squares(table)

    for _ in range(600):
        best = rng.normal(size=(2, 3, trials))
        other = rng.normal(size=(2, 3, trials))
        start = math.sqrt(0.7) * best + math.sqrt(0.3) * other if paired else other
        sides = [
            [drawn(size * scale, noise[k]) for k, size in enumerate((1, 3))]
            for noise, scale in ((start, 1.0), (best, 0.5))
        ]
        interval = objective.ratio(*sides, weights=[1.0, 0.5], paired=paired)
        misses += not interval.low < 2 < interval.high
    assert stats.binom.ppf(1e-4, 600, 0.03) <= misses <= stats.binom.isf(1e-4, 600, 0.07)


@pytest.mark.parametrize(
    "text", ["across", "about", "both", "across-99.73", "about-68", "across + 0.1 about"]
)
def test_what_a_budget_expects_is_the_statistic_of_such_errors(text):
    """Errors drawn with the variances of 2000 fields, 100 of each: within 2 %."""
    rng = np.random.default_rng(3)
    sigma = np.exp(rng.normal(0, 0.5, 2000))[:, None] * np.ones(3)
    law = ErrorLaw(np.zeros((2000, 3)), sigma, np.full(2000, 1 / 2000))
    budget = Budget((), BudgetLine("end to end", None, law), 1.0, 10.0)
    table = np.zeros(200_000, OUTCOMES)
    for k, axis in enumerate("xyz"):
        table[f"error_{axis}"] = rng.normal(0, np.repeat(sigma[:, k], 100))
    table["solved"] = True
    objective = Objective.read(text)
    expected = expected_error(objective, budget)
    assert expected == pytest.approx(objective.of(objective.squares(table)), rel=0.02)


@pytest.mark.parametrize("text", ["across-99.73", "across-95.45 per axis", "about-68.27"])
def test_a_level_of_each_resample_leaves_unsolved_trials_out(text):
    objective = Objective.read(text)
    table = np.zeros((3, 40), OUTCOMES)
    for axis in "xyz":
        table[f"error_{axis}"] = np.random.default_rng(3).normal(size=table.shape)
    table["solved"] = True
    solved = np.array([objective.squares(one) for one in table])
    unsolved = solved.copy()
    unsolved[:, 7] = np.nan
    np.testing.assert_array_equal(objective.of(unsolved), objective.of(np.delete(solved, 7, 1)))
    assert math.isnan(objective.of(solved[0, :0]))
