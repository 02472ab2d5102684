import numpy as np
import pytest

from startrack.optimise.tolerance import fit_surface, terms_needed


def test_a_quadratic_is_found_exactly():
    rng = np.random.default_rng(0)
    coordinates = rng.uniform(-1, 1, (30, 3))
    x, y, z = coordinates.T
    result = np.column_stack([1 + 2 * x - y * z + 3 * z**2, x])
    surface = fit_surface(coordinates, result)
    np.testing.assert_allclose(surface(np.array([[0.5, -1.0, 0.2]])), [[2.32, 0.5]], atol=1e-12)
    assert surface.error.max() < 1e-12


def test_the_stated_error_is_that_on_unseen_points():
    """Noise of 0.1, 10 coefficients, 60 points: the stated error is within 15 %."""
    rng = np.random.default_rng(1)
    stated, real = [], []
    for _ in range(200):
        coordinates, fresh = rng.uniform(-1, 1, (2, 60, 3))
        surface = fit_surface(coordinates, rng.normal(0, 0.1, (60, 1)))
        stated.append(surface.error[0] ** 2)
        real.append(np.mean((surface(fresh)[:, 0] - rng.normal(0, 0.1, 60)) ** 2))
    assert np.mean(stated) == pytest.approx(np.mean(real), rel=0.15)


def test_too_few_points_are_refused():
    assert terms_needed(2) == 6
    with pytest.raises(ValueError, match="more than 6 designs, got 6"):
        fit_surface(np.random.default_rng(0).uniform(-1, 1, (6, 2)), np.zeros((6, 1)))
