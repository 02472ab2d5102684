"""A sky that the tests simulate themselves, with scipy's normal law."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtr

from startrack.core import Floats


def paint(shape: tuple[int, int], x: Floats, y: Floats, flux: Floats, sigma: float) -> Floats:
    """Gaussian stars integrated over pixels, noise-free, on an empty image."""
    reach = int(np.ceil(7 * sigma)) + 1
    rows, columns = (side + 2 * reach for side in shape)
    x, y, flux = (np.ravel(each) for each in np.broadcast_arrays(x, y, flux))
    near = np.arange(-reach, reach + 1)
    u, v = (np.rint(centre).astype(int)[:, None] + near for centre in (x, y))
    along, down = (
        ndtr((pixel + 0.5 - centre) / sigma) - ndtr((pixel - 0.5 - centre) / sigma)
        for pixel, centre in ((u, x[:, None]), (v, y[:, None]))
    )
    place = (v[:, :, None] + reach) * columns + u[:, None] + reach
    light = flux[:, None, None] * down[:, :, None] * along[:, None]
    image = np.bincount(place.ravel(), light.ravel(), rows * columns).reshape(rows, columns)
    return image[reach:-reach, reach:-reach]


@pytest.fixture
def sky() -> Callable[..., Floats]:
    return paint
