"""Covariance of attitudes -> the same for a camera whose scale was fitted with them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def scale_unknown(covariance: Floats, seen: Floats, weight: Floats, tolerance: float) -> Floats:
    """What is left of the knowledge of an attitude once the focal length takes its share.

        C' = C + (C c)(C c)^T / (d - c^T C c)
        c = sum w z (-y, x, 0),   d = 1 / tolerance^2 + sum w z^2 (x^2 + y^2)

    the inverse of the information of attitude and scale together, its block of the attitude: a
    larger scale moves a star (x, y, z) away from the boresight, as a turn towards it would.

    covariance  (m, 3, 3) radian^2, about the camera's axes
    seen        (m, n, 3) unit vectors, camera axes
    weight      (m, n) radian^-2
    tolerance   1, standard deviation beforehand of the scale, over one
    Returns     (m, 3, 3) radian^2
    Errors      model: to first order.
    """
    loose = np.empty_like(covariance)
    _loosen(covariance, seen, weight, tolerance**-2, loose)
    return loose


@njit(cache=True, error_model="numpy")
def _loosen(covariance, seen, weight, known, loose):  # type: ignore[no-untyped-def]
    """Star by star, so that stars without weight change no digit."""
    for m in range(len(covariance)):
        share_x, share_y, left = 0.0, 0.0, known
        for n in range(weight.shape[1]):
            x, y, z = seen[m, n]
            w = weight[m, n] * z
            share_x, share_y = share_x - w * y, share_y + w * x
            left += w * z * (x * x + y * y)
        mixed = covariance[m, :, 0] * share_x + covariance[m, :, 1] * share_y
        left -= share_x * mixed[0] + share_y * mixed[1]
        for i in range(3):
            for j in range(3):
                loose[m, i, j] = covariance[m, i, j] + mixed[i] * mixed[j] / left
