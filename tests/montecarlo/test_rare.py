"""Rare events: the same probability, from far fewer trials."""

import numpy as np
import pytest
from scipy import stats

from startrack.montecarlo.attitudes import Regions, at_random
from startrack.montecarlo.rare import chances, probability, where_likely

REGIONS = Regions(8, 12)
SPOT = np.array([0.3, -0.5, 0.81]) / np.linalg.norm([0.3, -0.5, 0.81])
HALF = 0.12  # radian; a cap of (1 - cos) / 2 = 0.36 % of the sky
TRUTH = (1 - np.cos(HALF)) / 2


def in_cap(attitudes):
    return attitudes.inv().apply([0.0, 0.0, 1.0]) @ SPOT > np.cos(HALF)


def score(width):
    """How near a region's middle is to the cap: a guess, not the truth."""
    middle = REGIONS.place(np.arange(len(REGIONS)), np.full((len(REGIONS), 2), 0.5))
    return np.exp(-((np.arccos(np.clip(middle @ SPOT, -1, 1)) / width) ** 2))


@pytest.mark.parametrize("width", [0.3, 1.0])
def test_the_probability_is_that_of_the_area_and_its_interval_holds_it(width):
    """A cap's area is known; 60 estimates of 400 trials, coverage bound at 1e-4."""
    chance = chances(score(width))
    values, errors, hits = [], [], 0
    for seed in range(60):
        attitudes, weight = where_likely(seed, range(400), REGIONS, chance)
        mean = probability(in_cap(attitudes), weight)
        values.append(mean.value)
        errors.append(mean.error)
        interval = mean.interval()
        hits += interval.low <= TRUTH <= interval.high
    assert abs(np.mean(values) - TRUTH) < 4 * np.std(values) / np.sqrt(60)
    assert hits >= stats.binom.ppf(1e-4, 60, 0.9)
    alone = np.sqrt(TRUTH * (1 - TRUTH) / 400)
    assert np.std(values) < alone / (3 if width == 0.3 else 1.2)


def test_a_wrong_guess_costs_precision_but_not_truth():
    """All eyes on the other side of the sky: the defence still finds the cap."""
    chance = chances(score(0.3)[::-1])
    values = []
    for seed in range(60):
        attitudes, weight = where_likely(seed, range(400), REGIONS, chance)
        assert weight.max() <= 5
        values.append(probability(in_cap(attitudes), weight).value)
    assert abs(np.mean(values) - TRUTH) < 4 * np.std(values) / np.sqrt(60)


def test_weights_are_one_on_average():
    _, weight = where_likely(1, range(5000), REGIONS, chances(score(0.5)))
    assert abs(weight.mean() - 1) < 4 * weight.std() / np.sqrt(5000)


def test_random_attitudes_find_the_same():
    hits = in_cap(at_random(5, range(5000)))
    assert stats.binomtest(int(hits.sum()), 5000, TRUTH).pvalue > 1e-4


@pytest.mark.parametrize("bad", [np.zeros(4), np.array([1.0, -1.0]), np.array([np.nan, 1.0])])
def test_scores_that_are_none_are_refused(bad):
    with pytest.raises(ValueError, match="score must be finite, not negative"):
        chances(bad)
