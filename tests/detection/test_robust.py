"""Background about a spot: what Python does with arrays at the first run, against the loops."""

import numpy as np
import pytest

from startrack.core.interpret import twin
from startrack.core.kernel import KernelDispatcher
from startrack.detection.robust import around_among

NOBODY = np.empty(0, np.int64)
EVERYWHERE = np.arange(70).repeat(60), np.tile(np.arange(60), 70)


@pytest.mark.parametrize("place", [(20, 20), (0, 0), (69, 59), (24, 24)])
@pytest.mark.parametrize(
    "others",
    [(NOBODY, NOBODY), (np.array([20, 23, 30]), np.array([20, 26, 31])), EVERYWHERE],
    ids=["alone", "beside others", "in a crowd"],
)
def test_arrays_in_python_see_the_same_background(place, others):
    """With a slope and a star; sums of single precision may be taken in another order."""
    image = np.random.default_rng(2).normal(100, 5, (60, 70)) + 3 * np.arange(70)
    image[24:28, 26:30] += 400
    image = image.astype(np.float32)
    python = twin(around_among.py_func, lambda value: isinstance(value, KernelDispatcher))
    with np.errstate(all="ignore"):
        found = python(image, *place, 3, np.float64(0.1), *others)
    known = around_among(image, *place, 3, 0.1, *others)
    np.testing.assert_allclose(found, known, rtol=2e-5, atol=2e-5)
    assert found[-1] == known[-1]
