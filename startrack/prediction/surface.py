"""Draws -> the logarithm of each class of error, linear in the scores of the unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from startrack.budget import Term
from startrack.core import Floats, Refused, Streams, arcsec
from startrack.design import Unknown
from startrack.prediction.draws import Draw, stratified

LEAST = 1e-6 * arcsec  # radian, of a class of error, whose logarithm is taken
SPARE = 3  # draws beyond the unknown coefficients, below which nothing is fitted; chosen by hand


@dataclass(frozen=True, eq=False)
class ErrorSurface:
    """Classes of error of a design as a function of what is not known of it.

        ln(error) = constant + slope . scores + scatter z

    with a score for each unknown: the standard normal number of its quantile; of a choice of
    numbers their logarithm; of another choice one for each value but the first: 1 where it is
    taken, else 0.

    unknowns  whose scores these are
    terms     classes of error
    constant  (t, 2) ln radian, across and about
    slope     (t, 2, k)
    scatter   (t, 2) of what is not linear, and of the few units of a draw
    """

    unknowns: tuple[Unknown, ...]
    terms: tuple[Term, ...]
    constant: Floats
    slope: Floats
    scatter: Floats

    def errors(self, scores: Floats) -> Floats:
        """Radian (n, t, 2) for scores (n, k), without scatter."""
        return np.exp(self.constant + np.einsum("tak,nk->nta", self.slope, scores))

    def sample(self, seed: int, count: int) -> tuple[Floats, Floats]:
        """Scores (n, k) of the laws of all unknowns, and errors (n, t, 2), radian, with scatter."""
        scores = scores_of(
            self.unknowns,
            {
                unknown.name: stratified(seed, f"{unknown.name}, sampled", count)
                for unknown in self.unknowns
            },
            count,
        )
        normal = Streams(seed, 0)("scatter of errors").standard_normal(
            (count, *self.constant.shape)
        )
        return scores, self.errors(scores) * np.exp(self.scatter * normal)


def fit_surface(draws: Sequence[Draw]) -> ErrorSurface:
    """The surface through draws that have errors, by least squares.

    Raises    Refused where there are too few of them for as many unknowns.
    Accuracy  model: errors are products of powers of what is not known, as for most laws of noise
              and of displacements; what they are not is in the scatter. An unknown that only some
              of several files have counts as if all had it.
    """
    some = [draw for draw in draws if not draw.refused]
    unknowns = unknowns_of(some)
    quantiles = {
        unknown.name: np.array([draw.quantile.get(unknown.name, np.nan) for draw in some])
        for unknown in unknowns
    }
    scores = scores_of(unknowns, quantiles, len(some))
    if len(some) < scores.shape[1] + 1 + SPARE:
        raise Refused(
            f"draws must be {scores.shape[1] + 1 + SPARE} or more with an attitude for "
            f"{len(unknowns)} unknowns, got {len(some)}"
        )
    terms = tuple(term for term in Term if any(term in draw.terms for draw in some))
    value = np.array([[draw.terms.get(term, np.zeros(2)) for term in terms] for draw in some])
    logarithm = np.log(np.maximum(value, LEAST)).reshape(len(some), -1)
    model = np.column_stack([np.ones(len(some)), scores])
    found, *_ = np.linalg.lstsq(model, logarithm)
    free = len(some) - model.shape[1]
    scatter = np.sqrt(((logarithm - model @ found) ** 2).sum(axis=0) / free)
    shape = len(terms), 2
    return ErrorSurface(
        unknowns,
        terms,
        found[0].reshape(shape),
        found[1:].T.reshape(*shape, -1),
        scatter.reshape(shape),
    )


def unknowns_of(draws: Sequence[Draw]) -> tuple[Unknown, ...]:
    """All unknowns of some draws, each once."""
    return tuple({unknown.name: unknown for draw in draws for unknown in draw.unknowns}.values())


def scores_of(unknowns: Sequence[Unknown], quantiles: dict[str, Floats], count: int) -> Floats:
    """Scores (count, k) of quantiles (count,) by name; zero where an unknown has none (NaN)."""
    columns = list[Floats]()
    for unknown in unknowns:
        quantile = quantiles[unknown.name]
        if unknown.choice:
            taken = np.array([unknown.position(float(q)) if q == q else 0 for q in quantile])
            if unknown.numbers:
                columns.append(np.log(unknown.numbers)[taken])
                continue
            columns += [(taken == value).astype(float) for value in range(1, len(unknown.weights))]
        else:
            columns.append(np.nan_to_num(ndtri(quantile)))
    return np.column_stack(columns) if columns else np.zeros((count, 0))


def columns_of(unknown: Unknown) -> int:
    """Number of scores of an unknown."""
    return len(unknown.weights) - 1 if unknown.choice and not unknown.numbers else 1
