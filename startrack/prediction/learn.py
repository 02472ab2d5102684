"""Surface of errors and told figures -> the posterior distribution of each unknown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from startrack.budget import PUBLISHED
from startrack.core import Floats, Refused
from startrack.design import ERROR_FIGURES, INCLUDE, Told, Unknown, save_over
from startrack.io import to_table
from startrack.optimise import Chains, Ensembles, draw, thinned
from startrack.prediction.surface import FrameSurface, PredictionSurface

# The classes of error in each figure that may be told, by their names in budgets.
TERMS = dict(zip(ERROR_FIGURES, PUBLISHED.values(), strict=True))
START = 0.5  # standard deviation of the scores at which the walkers start
HOW = Ensembles(count=2, stretch=500, most_steps=10_000)
LEAST_FACTOR = 1.001  # least factor of a law, which must be above 1
# The figures say nothing of an unknown if its new spread over its earlier spread is at least
# SILENT, and its shift is at most UNMOVED. Chosen by hand.
SILENT, UNMOVED = 0.9, 0.2
FAR = 2.0  # standard deviations: larger shifts lead into the tails of a law; by hand
# Standard deviations of a told figure and the surface, by which the mean of all samples misses a
# contradicted figure; by hand.
CONTRADICTED = 3.0
NOT_A_CHANCE = 1e-3  # probability below which a value of a choice is left out


class Posterior(NamedTuple):
    """Distribution of an unknown after figures were told.

    unknown    the unknown with its new distribution; correlations with other unknowns are lost
    narrowing  1, spread of its score over the earlier spread
    shift      change of its mean, in standard deviations of its earlier distribution; for a choice,
               the largest change of the probability of a value
    """

    unknown: Unknown
    narrowing: float
    shift: float = 0.0

    @property
    def far(self) -> bool:
        """Whether its new distribution lies in the tails of the earlier one."""
        return abs(self.shift) > FAR

    @property
    def silent(self) -> bool:
        """Whether the figures say nothing of it."""
        return self.narrowing >= SILENT and abs(self.shift) <= UNMOVED


@dataclass(frozen=True, eq=False)
class Learned:
    """The unknowns of a design under told figures.

    told          the figures
    posteriors    one for each unknown; if the figures say nothing of it, with its earlier
                  distribution
    chains        chains of samples of the unknowns' normal scores
    contradicted  figures that the design cannot have, whatever the unknowns are: name, and the told
                  value over the mean of the samples
    """

    told: tuple[Told, ...]
    posteriors: tuple[Posterior, ...]
    chains: Chains
    contradicted: tuple[tuple[str, float], ...] = ()

    def quantiles(self, count: int) -> Floats:
        """Quantiles (n, unknowns) of joint samples of the unknowns."""
        return np.asarray(ndtr(thinned(self.chains.flat, count)))


def learn(surface: PredictionSurface, told: Sequence[Told], seed: int) -> Learned:
    """Sample the unknowns of a design given figures of its error.

        p(x | told) ~ p(x) prod_i N(ln value_i; ln figure_i(x), (ln factor_i)^2 + scatter_i^2)

    The variable x of each unknown is the normal score of its quantile, with a standard normal
    prior; the value of a choice also follows from x. The scatter is the scatter of the surface.

    Raises    Refused if nothing is unknown, or if the design has no error of a told class, or no
              such figure of frames.
    Accuracy  model: a told figure is assumed to hold for the middle of all units. numerical: see
              `Chains.reason_unconverged`.
    """
    if not surface.unknowns:
        raise Refused("told figures need values that are not known, got none")
    for figure in told:
        if figure.of_frames and figure.name not in surface.frames.names:
            raise Refused(f"told: the design has no {figure.name} in its frames")
        if not figure.of_frames and not surface.counted(TERMS[figure.figure]):
            raise Refused(f"told: the design has no error that {figure.figure} counts")

    def log_probability(theta: Floats) -> Floats:
        scores = surface.scores(ndtr(theta))
        value = -(theta**2).sum(axis=1) / 2
        for residual, variance in _residuals(surface, told, scores):
            value -= (residual**2 / variance + np.log(variance)) / 2
        return value

    def start(random: np.random.Generator, count: int) -> Floats:
        return START * random.standard_normal((count, len(surface.unknowns)))

    chains = draw(log_probability, start, seed, HOW)
    posteriors = list[Posterior]()
    for unknown, column in zip(surface.unknowns, chains.flat.T, strict=True):
        posterior = _posterior(unknown, column)
        posteriors.append(posterior._replace(unknown=unknown) if posterior.silent else posterior)
    scores = surface.scores(ndtr(chains.flat))
    contradicted = tuple(
        (figure.name, math.exp(float(residual.mean())))
        for figure, (residual, variance) in zip(
            told, _residuals(surface, told, scores), strict=True
        )
        if float(residual.mean()) ** 2 > CONTRADICTED**2 * float(np.mean(variance))
    )
    return Learned(tuple(told), tuple(posteriors), chains, contradicted)


def _residuals(
    surface: PredictionSurface, told: Sequence[Told], scores: Floats
) -> Iterator[tuple[Floats, Floats]]:
    """For each told figure, ln(told / expected) (n,), and its variance (n,) or ()."""
    errors = surface.errors(scores)
    for figure in told:
        if figure.of_frames:
            yield _of_frames(surface.frames, figure, scores)
        else:
            yield _of_errors(surface, figure, errors)


def _of_errors(surface: PredictionSurface, told: Told, errors: Floats) -> tuple[Floats, Floats]:
    """Residuals of a told error, from errors (n, t, 2) in radian."""
    which = surface.counted(TERMS[told.figure])
    square = errors[:, which] ** 2
    expected, weight = told.of_heads(np.sqrt(square.sum(axis=1)))
    share = square / square.sum(axis=1, keepdims=True)
    scatter = (share**2 * surface.scatter[which] ** 2).sum(axis=1)
    variance = math.log(told.factor) ** 2 + (weight**2 * scatter).sum(axis=1)
    return np.log(told.rms / expected), variance


def _of_frames(frames: FrameSurface, told: Told, scores: Floats) -> tuple[Floats, Floats]:
    """Residuals of a told figure of frames."""
    assert told.number is not None
    place = frames.names.index(told.name)
    residual = math.log(told.number) - frames.constant[place] - scores @ frames.slope[place]
    variance = math.log(told.factor) ** 2 + frames.scatter[place] ** 2
    return residual, np.asarray(variance)


def _posterior_of_choice(unknown: Unknown, score: Floats) -> Posterior:
    """Posterior of a choice from samples of its score: the probabilities of its values."""
    positions = unknown.positions(ndtr(score))
    after = np.bincount(positions, minlength=len(unknown.weights)) / len(score)
    before = np.array(unknown.weights)
    kept = [n for n, probability in enumerate(after) if probability >= NOT_A_CHANCE]
    if len(kept) < 2:  # a choice has two values or more
        kept = sorted(np.argsort(-after, kind="stable")[:2].tolist())
    law = {
        "among": [unknown.law["among"][n] for n in kept],
        "weight": [_rounded(max(float(after[n]), NOT_A_CHANCE)) for n in kept],
    }
    narrowing = float(np.sqrt((after * (1 - after)).sum() / (before * (1 - before)).sum()))
    return Posterior(Unknown(unknown.name, law), narrowing, float(np.abs(after - before).max()))


def _posterior(unknown: Unknown, score: Floats) -> Posterior:
    """Posterior of an unknown from samples of its score."""
    if unknown.choice:
        return _posterior_of_choice(unknown, score)
    values, law = unknown.numbers(ndtr(score)), dict[str, Any]()
    if (values > 0).all():
        logarithm = np.log(values)
        factor = max(math.exp(float(logarithm.std())), LEAST_FACTOR)
        median = _rounded(math.exp(float(logarithm.mean())))
        law = {"median": unknown.written(median), "factor": _rounded(factor)}
    else:  # the uniform law of the same mean and variance
        middle, half = float(values.mean()), math.sqrt(3) * float(values.std())
        ends = {"low": middle - half, "high": middle + half}
        law = {key: unknown.written(_rounded(end)) for key, end in ends.items()}
    return Posterior(Unknown(unknown.name, law), float(score.std()), float(score.mean()))


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def save_posterior(path: Path, design: Path, learned: Learned) -> None:
    """Write a design file that includes another one, with the distributions after told figures.

    The distributions contain the information of these figures. The file therefore does not contain
    the figures; new figures may be added. If a design includes one of several files, the
    probabilities of these files stay as in `design`. The learned probabilities are written as a
    comment.
    """
    table = dict[str, Any](told=[])
    comments = [f"{figure.name} was told" for figure in learned.told]
    for posterior in learned.posteriors:
        name, law = posterior.unknown.name, posterior.unknown.law
        *outer, last = name.split(".")
        if name.startswith(f"{INCLUDE} ") or any(part.isdecimal() for part in outer):
            comments.append(f"not in this file: {name}: {posterior.unknown}")
            continue
        inner = table
        for part in outer:
            inner = inner.setdefault(part, {})
        inner[last] = dict(law)
    save_over(path, design, table, "\n".join(comments))


def save_told(path: Path, design: Path, told: Sequence[Told]) -> None:
    """Write a design file that includes another one and adds told figures."""
    save_over(path, design, {"told": [to_table(figure) for figure in told]})
