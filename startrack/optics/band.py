"""A band of many wavelengths -> a few that stand for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh_tridiagonal

Floats = NDArray[np.float64]


def gauss_band(wavelength: Floats, weight: Floats, count: int) -> tuple[Floats, Floats]:
    """The Gaussian quadrature of a discrete band.

    `count` nodes and weights give the same sum as the whole band for every polynomial of degree
    up to 2 count - 1 in the wavelength.

    Source: Golub and Welsch (1969), Math. Comp. 23, 221; the recurrence by Lanczos.

    wavelength  (k,) metre
    weight      (k,) not negative
    count       wanted nodes; fewer come back where the band has fewer wavelengths
    Returns     (n,) metre; (n,) 1, that sum to one
    Errors      numerical: 1e-14 of the moments. ValueError where no weight is above zero.
    """
    used = weight > 0
    if not used.any():
        raise ValueError("weight must be above zero at one wavelength at least")
    nodes, share = wavelength[used], weight[used] / weight[used].sum()
    if len(nodes) <= count:
        return nodes, share
    middle, half = nodes.mean(), np.ptp(nodes) / 2
    x = (nodes - middle) / half
    basis = [np.sqrt(share)]
    diagonal, beside = [], []
    for _ in range(count):
        new = x * basis[-1]
        diagonal.append(float(new @ basis[-1]))
        # Against all before, twice: three-term recurrences alone lose orthogonality.
        for _ in range(2):
            for old in basis:
                new = new - (new @ old) * old
        beside.append(float(np.linalg.norm(new)))
        basis.append(new / beside[-1])
    value, vector = eigh_tridiagonal(diagonal, beside[:-1])
    return middle + half * value, vector[0] ** 2
