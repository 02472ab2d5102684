"""Gaussian processes: they interpolate their points, with right errors and gradients."""

import numpy as np
import pytest

from startrack.optimise.gaussian_process import emulator


def bowl(points):
    """A smooth function with a product and a variable that has no effect."""
    x, y, z = points.T[:3]
    return np.sin(3 * x) + 2 * (y - 0.4) ** 2 + x * z


def cube(count, dimensions=4, seed=0):
    return np.random.default_rng(seed).random((count, dimensions))


def test_it_goes_through_its_points():
    points = cube(40)
    found = emulator(points, bowl(points))
    mean, sigma = found.expected_and_sigma(points)
    assert mean == pytest.approx(bowl(points), abs=1e-4)
    assert sigma.max() < 1e-2


def test_the_error_falls_with_the_points():
    """By more than a factor of ten from 15 to 120 points."""
    errors = []
    for count in (15, 120):
        points = cube(count)
        found, fresh = emulator(points, bowl(points)), cube(500, seed=1)
        errors.append(np.sqrt(np.mean((found.expected(fresh) - bowl(fresh)) ** 2)))
    assert errors[1] < errors[0] / 10


def test_a_variable_that_does_not_matter_has_a_long_length():
    points = cube(60)
    length = emulator(points, bowl(points)).length
    assert length[3] > 5 * length[:2].max()


def test_the_true_value_lies_within_the_stated_error():
    """Of a random function of the same kind: 95 % within two sigma, here 90 at least of 100."""
    rng, inside = np.random.default_rng(3), []
    for _ in range(10):
        phase, rate = rng.random((2, 30)) * 2 * np.pi, rng.normal(0, 3, (30, 2))

        def wave(points, rate=rate, phase=phase):
            return np.cos(points @ rate.T + phase[0]).sum(axis=1) / 4

        points, fresh = rng.random((40, 2)), rng.random((10, 2))
        mean, sigma = emulator(points, wave(points)).expected_and_sigma(fresh)
        inside.extend(np.abs(mean - wave(fresh)) < 2 * sigma + 1e-6)
    assert sum(inside) >= 90


@pytest.mark.parametrize("sigmas", [0.0, -1.6, 1.6])
def test_gradients_are_those_of_differences(sigmas):
    points = cube(30)
    found, at, step = emulator(points, bowl(points)), np.array([0.3, 0.6, 0.2, 0.9]), 1e-6
    value, gradient = found.bound(at, sigmas)
    by_differences = [
        (found.bound(at + by, sigmas)[0] - found.bound(at - by, sigmas)[0]) / (2 * step)
        for by in step * np.eye(4)
    ]
    assert gradient == pytest.approx(by_differences, rel=1e-3, abs=1e-4)
    mean, sigma = found.expected_and_sigma(at[None])
    assert value == pytest.approx(mean[0] + sigmas * sigma[0])


def test_believing_itself_changes_no_mean():
    points, fresh = cube(30), cube(20, seed=2)
    found = emulator(points, bowl(points))
    after = found.with_point(fresh[0])
    assert after.expected(fresh) == pytest.approx(found.expected(fresh), abs=1e-3)
    assert (
        after.expected_and_sigma(fresh[:1])[1][0]
        < 0.1 * found.expected_and_sigma(fresh[:1])[1][0] + 1e-6
    )
