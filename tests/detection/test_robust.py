"""Background around a spot: Python's arrays of the first run against the compiled loops."""

import numpy as np
import pytest

from startrack.core.compiler import KernelDispatcher
from startrack.core.interpret import python_code
from startrack.detection.robust import around_among, around_each

NOBODY = np.empty(0, np.int64)
EVERYWHERE = np.arange(70).repeat(60), np.tile(np.arange(60), 70)


@pytest.mark.parametrize("place", [(20, 20), (0, 0), (69, 59), (24, 24)])
@pytest.mark.parametrize(
    "others",
    [(NOBODY, NOBODY), (np.array([20, 23, 30]), np.array([20, 26, 31])), EVERYWHERE],
    ids=["alone", "beside others", "in a crowd"],
)
def test_arrays_in_python_see_the_same_background(place, others):
    """With a slope and a star; sums in single precision may have another order."""
    image = np.random.default_rng(2).normal(100, 5, (60, 70)) + 3 * np.arange(70)
    image[24:28, 26:30] += 400
    image = image.astype(np.float32)
    python = python_code(around_among.py_func, lambda value: isinstance(value, KernelDispatcher))
    with np.errstate(all="ignore"):
        found = python(image, *place, 3, np.float64(0.1), *others)
    known = around_among(image, *place, 3, 0.1, *others)
    np.testing.assert_allclose(found, known, rtol=2e-5, atol=2e-5)
    assert found[-1] == known[-1]


def test_level_slopes_and_noise_about_many_spots_are_those_of_the_image():
    """36 rings of 88 pixels on a plane with noise of 5: four standard errors of their means."""
    row, column = np.indices((60, 60))
    image = np.random.default_rng(4).normal(100 + 3 * column - 2 * row, 5).astype(np.float32)
    y, x = (each.ravel() for each in np.mgrid[10:58:8, 10:58:8])
    level, slope_x, slope_y, noise = around_each(image, x, y, 3, 0.1).T
    assert np.mean(level - (100 + 3 * x - 2 * y)) == pytest.approx(0, abs=0.36)
    assert (slope_x.mean(), slope_y.mean()) == pytest.approx((3, -2), abs=0.08)
    assert noise.mean() == pytest.approx(5, rel=0.07)
