"""Nodes and places -> weights of the values at the nodes, by polynomials through them."""

from __future__ import annotations

import numpy as np

from startrack.core.arrays import Floats, Ints


def local_weights(nodes: Floats, at: Floats) -> tuple[Ints, Floats]:
    """First of the four nodes around each place, and the weights (n, 4) of a cubic through them."""
    step = nodes[1] - nodes[0]
    place = np.clip((at - nodes[0]) / step, 0, len(nodes) - 1)
    first = np.clip(np.floor(place).astype(np.int64) - 1, 0, len(nodes) - 4)
    return first, lagrange_weights(np.arange(4.0), place - first)


def lagrange_weights(nodes: Floats, at: Floats) -> Floats:
    """(n, k) weights of the values at nodes (k,) for those of the polynomial at places (n,)."""
    away = at[:, None] - nodes
    weight = np.ones((len(at), len(nodes)))
    for k in range(len(nodes)):
        for other in range(len(nodes)):
            if other != k:
                weight[:, k] *= away[:, other] / (nodes[k] - nodes[other])
    return weight
