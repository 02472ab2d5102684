"""Draws -> response surface: the logarithm of each error, linear in scores of the unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from startrack.budget import Term
from startrack.core import Floats, Refused, Streams, arcsec, printed
from startrack.design import Unknown, stratified
from startrack.prediction.draws import Draw

LEAST = 1e-6 * arcsec  # radian, least value of a class of error for the logarithm
FINEST = 1e-12  # least distance of a quantile from 0 and 1
EVEN = 12**0.5  # inverse standard deviation of a uniform law between 0 and 1
SPARE = 3  # least number of draws minus unknown coefficients for a fit; chosen by hand


@printed
@dataclass(frozen=True, eq=False)
class FrameSurface:
    """Figures of a design that frames measure, as a function of its unknown values.

    names     names of the figures; all figures are above zero in all draws
    constant  (f,) ln figure
    slope     (f, k)
    scatter   (f,)
    """

    names: tuple[str, ...]
    constant: Floats
    slope: Floats
    scatter: Floats


@printed
@dataclass(frozen=True, eq=False)
class PredictionSurface:
    """Classes of error of a design as a function of its unknown values.

        ln(error) = constant + slope . scores + scatter z

    Each unknown has a score: the normal score of its quantile; for a uniform law, a number of unit
    variance that is linear in the value; for a choice of numbers, the logarithm of the number. Any
    other choice has one score for each value except the first: 1 if this value is chosen, else 0.

    unknowns  unknowns in the order of their scores
    terms     classes of error
    constant  (t, 2) ln radian, across and about
    slope     (t, 2, k)
    scatter   (t, 2) by nonlinear terms, by the few units of a draw, and by errors that all draws
              share
    frames    figures that frames measure, with ln(figure) also linear in the scores
    """

    unknowns: tuple[Unknown, ...]
    terms: tuple[Term, ...]
    constant: Floats
    slope: Floats
    scatter: Floats
    frames: FrameSurface

    def counted(self, terms: Sequence[Term]) -> list[int]:
        """Indices of those of the given classes of error that the surface has."""
        return [place for place, term in enumerate(self.terms) if term in terms]

    def figure(self, errors: Floats, terms: Sequence[Term]) -> Floats:
        """Radian (n, 2): root sum of squares of some classes of error (n, t, 2)."""
        return np.sqrt((errors[:, self.counted(terms)] ** 2).sum(axis=1))

    def errors(self, scores: Floats) -> Floats:
        """Radian (n, t, 2) for scores (n, k), without scatter."""
        return np.exp(self.constant + np.einsum("tak,nk->nta", self.slope, scores))

    def sample(self, seed: int, count: int) -> Floats:
        """Quantiles (n, unknowns) of the laws of all unknowns."""
        names = (f"{unknown.name}, sampled" for unknown in self.unknowns)
        columns = [stratified(seed, name, count) for name in names]
        return np.column_stack(columns) if columns else np.zeros((count, 0))

    def scores(self, quantiles: Floats) -> Floats:
        """Scores (n, k) of quantiles (n, unknowns), which are finite at the ends of (0, 1)."""
        quantiles = np.clip(quantiles, FINEST, 1 - FINEST)
        by_name = {
            unknown.name: column for unknown, column in zip(self.unknowns, quantiles.T, strict=True)
        }
        return scores_of(self.unknowns, by_name, len(quantiles))

    def scattered(self, errors: Floats, seed: int, model: float = 0.0) -> Floats:
        """Errors (n, t, 2), radian, with the scatter of the surface and the error of the model.

        model  standard deviation of the logarithm of each class of error
        """
        normal = Streams(seed, 0)("scatter of errors").standard_normal(errors.shape)
        return np.asarray(errors * np.exp(np.hypot(self.scatter, model) * normal))


def fit_surface(draws: Sequence[Draw], common: float = 0.0) -> PredictionSurface:
    """Fit the surface to draws that have errors, by least squares.

    common    standard deviation of the logarithm of an error that all draws share; the draws do not
              show it, so it is added to their scatter
    Raises    Refused if there are too few draws for the number of unknowns.
    Accuracy  model: errors are products of powers of the unknown values, as in most laws of noise
              and of displacements; deviations are in the scatter. If only some of several included
              files have an unknown, it is treated as if all had it.
    """
    some = [draw for draw in draws if not draw.refused]
    unknowns = unknowns_of(some)
    quantiles = {
        unknown.name: np.array([draw.quantile.get(unknown.name, np.nan) for draw in some])
        for unknown in unknowns
    }
    scores = scores_of(unknowns, quantiles, len(some))
    require_draws(len(some), scores.shape[1], len(unknowns))
    terms = tuple(term for term in Term if any(term in draw.terms for draw in some))
    value = np.array([[draw.terms.get(term, np.zeros(2)) for term in terms] for draw in some])
    logarithm = np.log(np.maximum(value, LEAST)).reshape(len(some), -1)
    constant, slope, scatter = _fit(scores, logarithm)
    shape = len(terms), 2
    return PredictionSurface(
        unknowns,
        terms,
        constant.reshape(shape),
        slope.reshape(*shape, -1),
        np.hypot(scatter, common).reshape(shape),
        _of_frames(some, scores),
    )


def require_draws(draws: int, coefficients: int, unknowns: int) -> None:
    """Refuse draws that are too few for a fit.

    coefficients  number of slopes: one of each unknown, more of a choice of several values
    """
    if draws < coefficients + 1 + SPARE:
        raise Refused(
            f"draws with an attitude must be {coefficients + 1 + SPARE} or more for "
            f"{unknowns} unknowns, got {draws}"
        )


def _fit(scores: Floats, logarithm: Floats) -> tuple[Floats, Floats, Floats]:
    """Constants (m,), slopes (m, k) and scatters (m,) of logarithms (n, m), by least squares."""
    model = np.column_stack([np.ones(len(scores)), scores])
    terms = np.asarray(np.linalg.lstsq(model, logarithm)[0], float)
    freedom = len(scores) - model.shape[1]
    scatter = np.sqrt(((logarithm - model @ terms) ** 2).sum(axis=0) / freedom)
    return terms[0], terms[1:].T, np.asarray(scatter)


def _of_frames(draws: Sequence[Draw], scores: Floats) -> FrameSurface:
    """Figures that frames measure, in all draws."""
    names = tuple(name for name in draws[0].frames if all(d.frames.get(name, 0) > 0 for d in draws))
    value = np.array([[draw.frames[name] for name in names] for draw in draws])
    return FrameSurface(names, *_fit(scores, np.log(value)))


def unknowns_of(draws: Sequence[Draw]) -> tuple[Unknown, ...]:
    """All unknowns of some draws, each once."""
    return tuple({unknown.name: unknown for draw in draws for unknown in draw.unknowns}.values())


def scores_of(unknowns: Sequence[Unknown], quantiles: Mapping[str, Floats], count: int) -> Floats:
    """Scores (count, k) of quantiles (count,) by name; zero where an unknown has none (NaN)."""
    columns = list[Floats]()
    for unknown in unknowns:
        quantile = quantiles[unknown.name]
        given = np.isfinite(quantile)
        filled = np.where(given, quantile, 0.5)
        if not unknown.choice:
            columns.append(ndtri(filled) if "median" in unknown.law else EVEN * (filled - 0.5))
        elif unknown.in_order:
            columns.append(np.log(unknown.numbers(filled)))
        else:
            taken = np.where(given, unknown.positions(filled), 0)
            columns += [(taken == value).astype(float) for value in range(1, len(unknown.weights))]
    return np.column_stack(columns) if columns else np.zeros((count, 0))


def columns_of(unknown: Unknown) -> int:
    """Number of scores of an unknown."""
    several = unknown.choice and not unknown.in_order
    return len(unknown.weights) - 1 if several else 1
