import dataclasses
import math

import numpy as np
import pytest

from startrack.optimise.correction import fit_correction
from startrack.optimise.evaluate import Evaluation

TRIED = Evaluation((0.0,), {}, 1.0, 1.0, 0.0, {}, None, "")


class Tried(Evaluation):
    """An evaluation with 50 trials."""

    trials = 50


def tried(truth, count, rng):
    """Evaluations whose measured error has the noise of 50 trials of two axes."""
    for coordinates in rng.random((count, 2)):
        error = math.exp(truth(coordinates) + rng.normal(0, 0.5 / math.sqrt(50)))
        yield Tried(tuple(coordinates), {}, error, 1.0, 0.0, {}, None, "")


def test_a_plane_is_found_better_than_one_design_tells():
    """100 designs of 50 trials determine the plane to about 1 %, a single design to 7 %."""
    truth = lambda coordinates: 0.1 + 0.3 * coordinates[0] - 0.2 * coordinates[1]  # noqa: E731
    rng = np.random.default_rng(0)
    misses = []
    for _ in range(50):
        correction = fit_correction(list(tried(truth, 100, rng)), np.full(2, 0.5), 0.5)
        at = rng.random((20, 2))
        misses.append([correction(coordinates) - truth(coordinates) for coordinates in at])
    assert np.sqrt(np.mean(np.square(misses))) < 0.02


def test_nothing_tried_leaves_the_budget_as_it_is():
    correction = fit_correction([], np.full(2, 0.5), 0.5)
    assert correction(np.array([0.2, 0.9])) == 0


def test_far_and_unsolved_designs_do_not_count():
    rng = np.random.default_rng(0)
    near = list(tried(lambda _: 0.2, 30, rng))
    far = dataclasses.replace(TRIED, coordinates=(5.0, 5.0), error=100.0)
    lost = dataclasses.replace(TRIED, coordinates=(0.5, 0.5), error=math.nan)
    correction = fit_correction([*near, far, lost], np.full(2, 0.5), 0.5)
    assert correction(np.full(2, 0.5)) == pytest.approx(0.2, abs=0.05)


def test_the_standard_error_of_a_difference_holds():
    """The true difference lies within 3 standard errors in all but 2 of 100 repetitions."""
    truth = lambda coordinates: 0.1 + 0.3 * coordinates[0] - 0.2 * coordinates[1]  # noqa: E731
    rng, misses = np.random.default_rng(1), 0
    one, other = np.array([0.2, 0.3]), np.array([0.7, 0.9])
    for _ in range(100):
        correction = fit_correction(list(tried(truth, 40, rng)), np.full(2, 0.5), 0.5)
        found = correction(one) - correction(other)
        misses += abs(found - truth(one) + truth(other)) > 3 * correction.standard_error(one, other)
    assert misses <= 2
    assert correction.standard_error(one, one) == 0
