"""A quadratic through Monte Carlo results, with the error that it makes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surface:
    """Least-squares quadratic of one or more results over places.

    coefficients  (terms, k)
    error         (k,) root mean square of the leave-one-out residuals
    """

    coefficients: Floats
    error: Floats

    def __call__(self, place: Floats) -> Floats:
        """The results (n, k) at places (n, d)."""
        return _terms(place) @ self.coefficients


def fit(place: Floats, result: Floats) -> Surface:
    """Fit a quadratic.

    place   (n, d) in [-1, 1]
    result  (n, k)
    Errors  ValueError where there are no more points than the quadratic has terms.
    """
    terms = _terms(place)
    if len(place) <= terms.shape[1]:
        raise ValueError(
            f"a quadratic in {place.shape[1]} variables needs more than {terms.shape[1]} designs, "
            f"got {len(place)}"
        )
    coefficients = np.asarray(np.linalg.lstsq(terms, result, rcond=None)[0], float)
    q, _ = np.linalg.qr(terms)
    leverage = np.minimum((q**2).sum(axis=1), 1 - 1e-9)
    left_out = (result - terms @ coefficients) / (1 - leverage)[:, None]
    return Surface(coefficients, np.asarray(np.sqrt(np.mean(left_out**2, axis=0)), float))


def terms_needed(dimensions: int) -> int:
    """How many coefficients a quadratic has."""
    return (dimensions + 1) * (dimensions + 2) // 2


def _terms(place: Floats) -> Floats:
    n, d = place.shape
    i, j = np.triu_indices(d)
    return np.column_stack([np.ones(n), place, place[:, i] * place[:, j]])
