"""Points and weights that average over an exposure, its start and its end among them."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.special import eval_legendre, roots_jacobi

from startrack.core import Floats

PANEL = 64  # points beyond which the exposure is cut: finding the points costs their square


@lru_cache(maxsize=128)
def points(count: int) -> tuple[Floats, Floats, Floats]:
    """About `count` Gauss-Lobatto points of an exposure from -1/2 to 1/2, both ends included.

    Beyond 64 points there are several panels, which share their ends.

    Returns  (p,) 1, where the panels start; (j,) 1, the points of each, from its start; and (m,)
             1, weights of all points in order, `joined`, that sum to 1
    Accuracy  numerical: exact for polynomials of degree 2 j - 3 in each panel.
    """
    panels = math.ceil((count - 1) / (PANEL - 1))
    each = max(math.ceil((count - 1) / panels), 2) + 1
    node, weight = _lobatto(each)
    total = np.zeros(panels * (each - 1) + 1)
    for k in range(panels):
        total[k * (each - 1) : (k + 1) * (each - 1) + 1] += weight / (2 * panels)
    return np.arange(panels) / panels - 0.5, (node + 1) / (2 * panels), total


def joined(panels: Floats) -> Floats:
    """What belongs to the points of each panel (p, j, ...) in one line (m, ...), each end once."""
    return np.concatenate([panels[:, :-1].reshape(-1, *panels.shape[2:]), panels[-1:, -1]])


def _lobatto(count: int) -> tuple[Floats, Floats]:
    """Points and weights on [-1, 1] (Abramowitz and Stegun 1964, 25.4.32)."""
    node = np.concatenate([[-1.0], roots_jacobi(count - 2, 1, 1)[0], [1.0]])
    weight = 2 / (count * (count - 1) * eval_legendre(count - 1, node) ** 2)
    return node, weight
