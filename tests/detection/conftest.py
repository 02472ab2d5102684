"""A sky that the tests paint themselves, with scipy's normal law."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtr

from startrack.core import Floats


def paint(shape: tuple[int, int], x: Floats, y: Floats, flux: Floats, sigma: float) -> Floats:
    """Gaussian stars integrated over pixels, noise-free, on an empty image."""
    reach = int(np.ceil(7 * sigma)) + 1
    image = np.zeros((shape[0] + 2 * reach, shape[1] + 2 * reach))
    for cx, cy, f in np.broadcast(x, y, flux):
        left, top = round(cx) - reach, round(cy) - reach
        u = np.arange(left, left + 2 * reach + 1)
        v = np.arange(top, top + 2 * reach + 1)
        along = ndtr((u + 0.5 - cx) / sigma) - ndtr((u - 0.5 - cx) / sigma)
        down = ndtr((v + 0.5 - cy) / sigma) - ndtr((v - 0.5 - cy) / sigma)
        image[np.ix_(v + reach, u + reach)] += f * np.outer(down, along)
    return image[reach:-reach, reach:-reach]


@pytest.fixture
def sky() -> Callable[..., Floats]:
    return paint
