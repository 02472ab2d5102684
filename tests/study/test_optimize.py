import dataclasses
import math

import nlopt
import numpy as np
import pytest

from startrack.study.box import Box
from startrack.study.montecarlo import OUTCOMES, Serial
from startrack.study.optimize import evaluate, improvement, optimize


@pytest.fixture(scope="module")
def optimum(small):
    return optimize(small.case, small.campaign, 3, Serial())


def test_the_best_is_better_on_fresh_trials(optimum):
    assert optimum.feasible
    assert optimum.factor.low > 1
    start, best = optimum.fresh
    assert best.across.value < start.across.value
    assert start.trials == best.trials == 60


def test_the_best_is_the_best_feasible_one_that_was_seen(optimum, small):
    feasible = [one for one in optimum.evaluations if one.feasible]
    best = min(feasible, key=lambda one: one.score)
    box = Box(small.case, small.campaign.variables)
    np.testing.assert_allclose(box.place(optimum.best), best.place, atol=1e-12)
    assert optimum.promised == best.rms("across")
    assert len(optimum.evaluations) == 14


def test_every_design_lies_in_the_box(optimum):
    places = np.array([one.place for one in optimum.evaluations])
    assert ((places >= 0) & (places <= 1)).all()


def test_the_same_seed_finds_the_same_design(optimum, small):
    again = optimize(small.case, small.campaign, 3, Serial())
    assert again.best == optimum.best
    assert again.factor == optimum.factor


def test_designs_are_compared_on_the_same_sky(small):
    box = Box(small.case, small.campaign.variables)
    one = evaluate(box, small.campaign, box.start, 3, Serial(), 1)
    again = evaluate(box, small.campaign, box.start, 3, Serial(), 1)
    assert one == again


def test_a_design_that_breaks_a_limit_is_not_feasible(small):
    tight = dataclasses.replace(small.campaign.requirements, max_mass=0.01)
    campaign = dataclasses.replace(small.campaign, requirements=tight)
    box = Box(small.case, campaign.variables)
    done = evaluate(box, campaign, box.start, 3, Serial(), 1)
    free = evaluate(box, small.campaign, box.start, 3, Serial(), 1)
    assert not done.feasible
    assert done.margins["mass"] < 0
    assert done.score > free.score + 10


def test_a_design_that_cannot_be_built_is_recorded_not_raised(small, blind):
    box = Box(blind, small.campaign.variables)
    done = evaluate(box, small.campaign, box.start, 3, Serial(), 1)
    assert done.summary is None
    assert "must overlap" in done.note
    assert math.isfinite(done.score)


def test_roundoff_in_nlopt_keeps_the_best(small, monkeypatch):
    """nlopt throws away a good design when rounding stops it; we keep it and say so."""
    real = nlopt.opt

    class Limited:
        def __init__(self, *args):
            self._inner = real(*args)
            self._left = 4

        def __getattr__(self, name):
            return getattr(self._inner, name)

        def set_min_objective(self, objective):
            self._objective = objective

        def optimize(self, start):
            for step in (0.0, 0.02, 0.04, 0.06):
                self._objective(np.clip(start + step, 0, 1), np.empty(0))
            raise nlopt.RoundoffLimited("roundoff")

    monkeypatch.setattr(nlopt, "opt", Limited)
    optimum = optimize(small.case, small.campaign, 3, Serial())
    assert "rounding" in optimum.ending
    assert len(optimum.evaluations) == 4
    assert optimum.promised == min(one.rms("across") for one in optimum.evaluations if one.feasible)


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
        interval = improvement(outcomes(start), outcomes(best), "across", 1)
        misses += not interval.low < 2 < interval.high
    assert misses <= 13


def test_a_design_that_solves_nothing_has_no_factor():
    nothing = outcomes(np.full(5, np.nan))
    assert math.isnan(improvement(nothing, outcomes(np.ones(5)), "across", 1).value)
