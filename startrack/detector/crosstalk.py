"""Crosstalk: electrons that diffuse into the pixels beside the one that they were made in."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def diffuse(electrons: Floats, share: float) -> Floats:
    """Expected electrons after a share of each pixel's went to each of its four sides.

        after = (1 - 4 share) electrons + share (left + right + above + below)

    Each electron goes its own way, so that Poisson numbers stay independent Poisson numbers, and
    the expectations alone need to be spread. Source: Janesick (2001), Scientific Charge-Coupled
    Devices, on diffusion; here the kernel is cut to the nearest pixels.

    electrons  (rows, columns) electron; at the borders, none leaves
    share      1, at most 1/4
    """
    kernel = np.array([[0, share, 0], [share, 1 - 4 * share, share], [0, share, 0]])
    return np.asarray(cv2.filter2D(electrons, -1, kernel, borderType=cv2.BORDER_REFLECT))
