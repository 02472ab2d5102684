"""Designs whose optimum is known without an optimiser."""

import math

import numpy as np
import pytest
from centre_of_gravity import centre_of_gravity_error

from startrack.metrics import Star
from startrack.optimise.search import Search, minimise


@pytest.mark.parametrize(("window", "best"), [(3, 0.42), (5, 0.574), (7, 0.696)])
def test_the_width_of_a_star_that_suits_its_window(window, best):
    """S-curve of the centre of gravity: undersampled for small stars, cut off for large ones; no
    noise."""

    def bias(coordinates):
        return centre_of_gravity_error(Star(1e12, 0.3 + 0.7 * coordinates[0]), window)[1]

    found = minimise(lambda p: math.log(bias(p)), np.array([0.9]), Search(evaluations=60))
    assert 0.3 + 0.7 * found.coordinates[0] == pytest.approx(best, rel=0.02)


def test_the_exposure_between_shot_noise_and_smear():
    """Variance of the mean of photons from a smeared star: (s^2 + (v t)^2 / 12) / (rate t).

    Least at t = sqrt(12) s / v. The smeared star is drawn photon by photon, 20,000 of them, and
    each exposure takes the same draws.
    """
    rng = np.random.default_rng(0)
    sigma, rate = 0.8, 5.0  # pixel, pixel / s
    core, along = rng.normal(0, sigma, 20_000), rng.random(20_000) - 0.5

    def error(coordinates):
        exposure = 0.05 * 60 ** coordinates[0]
        return float(np.var(core + rate * exposure * along) / exposure)

    found = minimise(lambda p: math.log(error(p)), np.array([0.1]), Search(evaluations=80))
    exposure = 0.05 * 60 ** found.coordinates[0]
    assert exposure == pytest.approx(math.sqrt(12) * sigma / rate, rel=0.02)
