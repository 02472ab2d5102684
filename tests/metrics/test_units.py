"""Intervals of trials of units: trials of one unit share its bias."""

import math

import numpy as np
import pytest

from startrack.design import Accuracy, Objective
from startrack.metrics import ErrorLimits, independent, level_bounds, summarise, units_of
from startrack.montecarlo import Precision, differences
from startrack.population import with_units
from startrack.trial import OUTCOMES
from startrack.verification.decide import Answer, Claim

EACH = 10  # trials of a unit


def drawn(rng: np.random.Generator, units: int, bias: float, right: float = 1.0) -> np.ndarray:
    """Trials of noise 1 about each axis, and of a bias of each unit; some are wrong."""
    rows = np.zeros(units * EACH, OUTCOMES)
    rows["trial"] = np.arange(len(rows))
    rows["solved"] = np.repeat(rng.random(units) < right, EACH)
    for axis in "xyz":
        own = np.repeat(rng.normal(0, bias, units), EACH) if bias else 0.0
        rows[f"error_{axis}"] = own + rng.normal(size=len(rows))
        rows[f"sigma_{axis}"] = math.hypot(1, bias)
    return with_units(rows, EACH)


@pytest.mark.parametrize("bias", [0.0, 1.0, 3.0])
def test_an_rms_over_units_is_in_its_interval(bias):
    """Of 500 campaigns with 12 units; false alarm 1e-3. Trials taken as independent hold 0.5 of 3
    sigma of bias."""
    rng, truth = np.random.default_rng(1), math.sqrt(1 + bias**2)
    found = [summarise(drawn(rng, 12, bias)).about for _ in range(500)]
    assert sum(one.low <= truth <= one.high for one in found) >= 459


def test_an_availability_of_units_that_fail_whole_is_in_its_interval():
    rng = np.random.default_rng(2)
    found = [summarise(drawn(rng, 40, 0.0, 0.8)).availability for _ in range(300)]
    assert sum(one.low <= 0.8 <= one.high for one in found) >= 270


def test_two_designs_are_compared_by_their_units():
    """The second design has another bias of each unit, with the same law."""
    rng, met = np.random.default_rng(3), 0
    for _ in range(300):
        pair = drawn(rng, 12, 3.0), drawn(rng, 12, 3.0)
        across, _, level, _, available = differences(*pair)
        met += across.change.low <= 1 <= across.change.high
        assert level.change.high == math.inf
        assert available.change.high > 0.1  # 12 units, not 120 trials
    assert met >= 270


def test_the_values_of_units_have_the_mean_of_all_trials():
    rows = drawn(np.random.default_rng(4), 5, 1.0)[:-3]  # the last unit has fewer trials
    values = rows["error_x"] ** 2
    assert len(independent(values, rows)) == 5
    assert independent(values, rows).mean() == pytest.approx(values.mean())
    alone = rows[list(OUTCOMES.names)]
    assert units_of(alone) is None
    assert summarise(alone).units == 0
    assert summarise(rows).units == 5


def test_a_precision_over_units_needs_units():
    """Each unit has one error in all its trials: 40 units bound no level of 99.73 %."""
    rng = np.random.default_rng(5)
    rows = drawn(rng, 400, 0.0)
    rows["error_x"] = rows["error_y"] = np.repeat(rng.normal(size=400), EACH)
    few, many = Precision(0.1), Precision(0.1, "across-99.73")
    as_one = few.interval(rows[::EACH])
    every = few.interval(rows)
    assert (every.low, every.high) == pytest.approx((as_one.low, as_one.high))
    assert many.interval(rows).high == math.inf
    assert level_bounds(np.arange(4000.0), 0.9, 0.05, 0.05, 400)[1] == pytest.approx(
        level_bounds(np.arange(9.0, 4000.0, 10), 0.9, 0.05, 0.05)[1]
    )


def test_few_units_have_a_bound_in_a_verdict():
    """As in the summary; ten trials would be too few of one unit."""
    rows = drawn(np.random.default_rng(6), 6, 1.0)
    claim = Claim(Accuracy(Objective("about"), 100.0), 0.0, ErrorLimits(math.inf, math.inf))
    bounds = claim.bounds(rows, np.empty((0, 3)), 0.025, 0.025)
    assert claim.answer(bounds) is Answer.PASS
