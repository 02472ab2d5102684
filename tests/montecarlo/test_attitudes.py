"""Attitudes that cover the rotations better than chance does, and are uniform all the same."""

import numpy as np
import pytest
from scipy import stats

from startrack.montecarlo.attitudes import (
    REPLICATES,
    Regions,
    at_random,
    by_regions,
    by_sobol,
    towards,
)

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
