"""Attitudes that cover the rotations more evenly than random ones, and are still uniform."""

import numpy as np
import pytest
from intervals_oracles import rare_probability
from scipy import stats
from variance import by_regions

from startrack.montecarlo.attitudes import (
    REPLICATES,
    Regions,
    at_random,
    by_sobol,
    chances,
    towards,
    where_likely,
)
from startrack.montecarlo.estimate import probability

REGIONS = Regions(4, 6)


def regional(seed, numbers):
    return by_regions(seed, numbers, REGIONS)


@pytest.mark.parametrize("attitudes", [at_random, by_sobol, regional])
def test_every_attitude_is_uniform_over_the_rotations(attitudes):
    """Haar's measure: each matrix entry is uniform in [-1, 1], the angle has the density
    (1 - cos) / pi. Kolmogorov and Smirnov on one attitude of each of 300 seeds, each at 1e-5."""
    if attitudes is regional:  # one region is not the sky: take all of them in turn
        made = [attitudes(seed, [seed % len(REGIONS)])[0] for seed in range(1500 // 24 * 24)]
    else:
        made = [attitudes(seed, range(6))[-1] for seed in range(300)]
    matrix = np.array([one.as_matrix() for one in made])
    for i in range(3):
        for j in range(3):
            assert stats.kstest(matrix[:, i, j], "uniform", (-1, 2)).pvalue > 1e-5
    angle = np.array([one.magnitude() for one in made])
    assert stats.kstest(angle, lambda a: (a - np.sin(a)) / np.pi).pvalue > 1e-5


def test_sobol_integrates_smooth_functions_better_than_chance():
    """The mean of a spherical harmonic is 0: its error falls faster than 1 / sqrt(n)."""

    def error(attitudes, n):
        means = []
        for seed in range(12):
            matrix = attitudes(seed, range(n)).as_matrix()
            means.append(np.mean(matrix[:, 2, 2] ** 2 + matrix[:, 0, 1] * matrix[:, 1, 2]) - 1 / 3)
        return np.sqrt(np.mean(np.square(means)))

    chance = error(at_random, 1024)
    few, many = error(by_sobol, 256), error(by_sobol, 4096)
    assert error(by_sobol, 1024) < chance / 2
    assert np.log(few / many) / np.log(16) > 0.6


@pytest.mark.parametrize("attitudes", [at_random, by_sobol, regional])
def test_an_attitude_depends_on_its_number_alone(attitudes):
    whole = attitudes(7, range(100)).as_quat()
    part = attitudes(7, [60, 3, 99]).as_quat()
    np.testing.assert_array_equal(part, whole[[60, 3, 99]])
    assert not np.isin(attitudes(8, range(5)).as_quat(), whole).any()


def test_replicates_are_samples_of_their_own():
    first = by_sobol(1, range(0, 64 * REPLICATES, REPLICATES)).as_quat()
    second = by_sobol(1, range(1, 64 * REPLICATES, REPLICATES)).as_quat()
    assert not np.isclose(first, second).all(axis=1).any()


def test_regions_are_looked_into_in_turn():
    boresight = regional(3, range(72)).inv().apply([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(REGIONS.of(boresight), np.arange(72) % 24)


def test_a_boresight_points_where_it_is_told_to():
    rng = np.random.default_rng(0)
    want = rng.standard_normal((50, 3))
    want /= np.linalg.norm(want, axis=1)[:, None]
    roll = rng.random(50)
    attitude = towards(want, roll)
    np.testing.assert_allclose(attitude.inv().apply([0, 0, 1.0]), want, atol=1e-12)
    turned = towards(want, roll + 0.1)
    np.testing.assert_allclose((turned * attitude.inv()).magnitude(), 0.1)


@pytest.mark.parametrize("regions", [Regions(), Regions(1, 7), Regions(9, 1)])
def test_directions_at_random_fall_evenly_into_the_regions(regions):
    """A normal vector has a random direction; chi-square, false alarm 1e-4."""
    direction = np.random.default_rng(2).standard_normal((20_000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    count = np.bincount(regions.of(direction), minlength=len(regions))
    assert len(count) == len(regions)
    assert stats.chisquare(count).pvalue > 1e-4


def test_what_is_placed_in_a_region_lies_there_and_nowhere_else():
    regions = Regions(5, 8)
    cell = np.repeat(np.arange(len(regions)), 50)
    place = regions.place(cell, np.random.default_rng(3).random((len(cell), 2)))
    np.testing.assert_allclose(np.linalg.norm(place, axis=1), 1)
    np.testing.assert_array_equal(regions.of(place), cell)


def test_the_poles_have_a_region():
    poles = Regions().of(np.array([[0.0, 0, 1], [0, 0, -1]]))
    assert poles[0] >= len(Regions()) - 12
    assert poles[1] < 12


FINE_REGIONS = Regions(8, 12)
SPOT = np.array([0.3, -0.5, 0.81]) / np.linalg.norm([0.3, -0.5, 0.81])
HALF = 0.12  # radian; a cap of (1 - cos) / 2 = 0.36 % of the sky
TRUTH = (1 - np.cos(HALF)) / 2


def in_cap(attitudes):
    return attitudes.inv().apply([0.0, 0.0, 1.0]) @ SPOT > np.cos(HALF)


def score(width):
    """Distance of a region's middle from the cap: a guess, not the truth."""
    middle = FINE_REGIONS.place(np.arange(len(FINE_REGIONS)), np.full((len(FINE_REGIONS), 2), 0.5))
    return np.exp(-((np.arccos(np.clip(middle @ SPOT, -1, 1)) / width) ** 2))


@pytest.mark.parametrize("width", [0.3, 1.0])
def test_the_probability_is_that_of_the_area_and_its_interval_holds_it(width):
    """The area of a cap is known; 60 estimates of 400 trials, coverage bound at 1e-4."""
    chance = chances(score(width))
    values, errors, hits = [], [], 0
    for seed in range(60):
        attitudes, weight = where_likely(seed, range(400), FINE_REGIONS, chance)
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
    """If all guesses are on the other side of the sky, the uniform part of the trials still
    finds the cap."""
    chance = chances(score(0.3)[::-1])
    values = []
    for seed in range(60):
        attitudes, weight = where_likely(seed, range(400), FINE_REGIONS, chance)
        assert weight.max() <= 5
        values.append(probability(in_cap(attitudes), weight).value)
    assert abs(np.mean(values) - TRUTH) < 4 * np.std(values) / np.sqrt(60)


def test_weights_are_one_on_average():
    _, weight = where_likely(1, range(5000), FINE_REGIONS, chances(score(0.5)))
    assert abs(weight.mean() - 1) < 4 * weight.std() / np.sqrt(5000)


def test_random_attitudes_find_the_same():
    hits = in_cap(at_random(5, range(5000)))
    assert stats.binomtest(int(hits.sum()), 5000, TRUTH).pvalue > 1e-4


@pytest.mark.parametrize("bad", [np.zeros(4), np.array([1.0, -1.0]), np.array([np.nan, 1.0])])
def test_scores_that_are_none_are_refused(bad):
    with pytest.raises(ValueError, match="score must be finite, not negative"):
        chances(bad)


def test_a_rare_probability_is_that_of_openturns():
    """The probability that a field has too few stars, 1.1e-3; a false alarm in 1e-4 of the
    seeds."""
    pytest.importorskip("openturns", reason="OpenTURNS is not installed: no probability beside it")
    found = rare_probability(4000)
    assert found["rare_ratio"] == pytest.approx(1, abs=4 * found["rare_ratio_sigma"])
    assert found["rare_ratio_sigma"] < 0.2
