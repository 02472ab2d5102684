"""Motion -> Path: a slew at constant rate, in the nodes of a Gaussian quadrature over time."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from startrack.motion.parameters import Motion
from startrack.values import Path

NODES_PER_PIXEL = 2.0
FEWEST_NODES = 5
MOST_NODES = 512


@lru_cache(maxsize=64)
def slew(motion: Motion, exposure: float, pixel_angle: float) -> Path:
    """The path of the line of sight at constant rate.

    A star's image is the mean of its PSF over the exposure. Gauss-Legendre nodes in time give
    that mean with an error that falls exponentially, because the PSF is smooth.

    exposure     second
    pixel_angle  radian that a pixel spans; sets how many nodes a smear needs
    Errors       ValueError where the smear needs more than 512 nodes, 256 pixel.
                 numerical: 1e-6 of the flux for a PSF of sigma 0.5 pixel or wider.
    """
    smear = motion.rate * exposure / pixel_angle
    if smear == 0:
        return Path(np.zeros(1), np.ones(1), np.zeros((1, 3)))
    count = math.ceil(FEWEST_NODES + NODES_PER_PIXEL * smear)
    if count > MOST_NODES:
        raise ValueError(
            f"the slew must smear a star over at most {MOST_NODES / NODES_PER_PIXEL:.0f} pixel in "
            f"an exposure, got {smear:.0f}"
        )
    node, weight = np.polynomial.legendre.leggauss(count)
    time = node * exposure / 2
    rate = np.array([motion.rate_x, motion.rate_y, motion.rate_z])
    return Path(time, weight / 2, time[:, None] * rate)
