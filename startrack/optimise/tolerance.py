"""Design -> how far each parameter may vary, by emcee on a quadratic surface."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy import special

from startrack.core import Floats
from startrack.design import Campaign, Case, DesignSpace
from startrack.optimise.ensemble import Chains, draw, thinned
from startrack.optimise.evaluate import Evaluation, evaluate
from startrack.optimise.runner import TrialRunner


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
    Raises  ValueError where there are no more points than the quadratic has terms.
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


DESIGNS_PER_TERM = 2.5
CHECKS = 12


@dataclass(frozen=True, eq=False)
class Tolerance:
    """The designs around a centre that keep the error under a limit.

    box            the variables
    chains         places in the box's unit cube, drawn in proportion to the probability that the
                   design meets the limit and the requirements
    limit          radian, error that must be kept
    surface_error  ln(error), leave-one-out error of the response surface
    check_error    ln(error), rms difference to Monte Carlo at designs of the region that the
                   surface has not seen
    expected       1, mean probability of those designs to keep the limit and the requirements, by
                   the surface
    kept           1, fraction of them that did by Monte Carlo
    checks         how many of these designs there were
    evaluations    all designs that were tried
    """

    box: DesignSpace
    chains: Chains
    limit: float
    surface_error: float
    check_error: float
    expected: float
    kept: float
    checks: int
    evaluations: tuple[Evaluation, ...]

    @property
    def samples(self) -> Floats:
        """(n, d) places."""
        return self.chains.flat


def sample(
    case: Case,
    campaign: Campaign,
    bench: TrialRunner,
    watch: Callable[[Evaluation], None] | None = None,
) -> Tolerance:
    """Sample the tolerance region around a design.

    Monte Carlo at designs of a Latin hypercube in a box around the case; a quadratic through
    ln(error) and through each margin; emcee (Foreman-Mackey et al. 2013, PASP 125, 306) on

        p(design) ~ P(ln error <= ln limit) * prod_i P(margin_i >= 0)

    with normal laws of the surfaces' own errors. The density is a function, not a Monte Carlo, so
    that the sampler sees no noise. Designs drawn from the region are then tried.

    Raises    ValueError where the campaign names no variables or the centre cannot be tried.
    Accuracy  model: a quadratic; its error is in the result, measured twice.
    """
    box = DesignSpace(case, campaign.variables, campaign.links)
    campaign = replace(campaign, trials=campaign.sample_trials, most_trials=campaign.sample_trials)
    d = len(box)
    low = np.maximum(box.start - campaign.span, 0)
    high = np.minimum(box.start + campaign.span, 1)
    rng = np.random.default_rng(bench.seed)
    cube = scipy.stats.qmc.LatinHypercube(d, rng=rng).random(designs_needed(d) - CHECKS)
    cube[0] = (box.start - low) / (high - low)
    evaluations = []

    def measure(places: Floats) -> list[Evaluation]:
        for u in places:
            evaluations.append(evaluate(box, campaign, low + (high - low) * u, bench))
            if watch:
                watch(evaluations[-1])
        return evaluations[-len(places) :]

    tried = measure(cube)
    if not tried[0].error > 0:
        raise ValueError(
            f"the design must work to be sampled around: {tried[0].note or 'unsolved'}"
        )
    at, results = _results(2 * cube - 1, tried)
    # What is the same everywhere, such as a power that no variable changes, needs no surface.
    moving = np.ptp(results, axis=0) > 0
    if (results[0, 1:][~moving[1:]] < 0).any():
        raise ValueError("the design misses a requirement that no variable changes")
    surface = fit(at, results[:, moving])
    limit = math.log(tried[0].error) + math.log1p(campaign.margin)
    log_probability = region(surface, limit)

    def middle(rng: np.random.Generator, n: int) -> Floats:
        return 0.3 * rng.uniform(-1, 1, (n, d))

    chains = draw(log_probability, middle, bench.seed, ledger=bench.ledger)
    picks = thinned(chains.flat, CHECKS)
    checked = measure((picks + 1) / 2)
    at, truth = _results(picks, checked)
    difference = surface(at)[:, 0] - truth[:, 0] if len(at) else np.array([np.nan])
    kept = [one.feasible and math.log(one.error) <= limit for one in checked]
    return Tolerance(
        box,
        replace(chains, samples=low + (high - low) * (chains.samples + 1) / 2),
        math.exp(limit),
        float(surface.error[0]),
        float(np.sqrt(np.mean(difference**2))),
        float(np.exp(log_probability(picks)).mean()),
        float(np.mean(kept)),
        len(at),
        tuple(evaluations),
    )


def designs_needed(dimensions: int) -> int:
    """How many designs `sample` tries: those for the surface and those that check it."""
    return 1 + math.ceil(DESIGNS_PER_TERM * terms_needed(dimensions)) + CHECKS


def region(surface: Surface, limit: float) -> Callable[[Floats], Floats]:
    """The logarithm of the probability that a place (n, d) in [-1, 1] keeps limit and margins."""
    error = np.maximum(surface.error, 1e-6)

    def log_probability(places: Floats) -> Floats:
        predicted = surface(places)
        score = special.log_ndtr((limit - predicted[:, 0]) / error[0])
        score += special.log_ndtr(predicted[:, 1:] / error[1:]).sum(axis=1)
        return np.where((np.abs(places) <= 1).all(axis=1), score, -np.inf)

    return log_probability


def _results(places: Floats, tried: list[Evaluation]) -> tuple[Floats, Floats]:
    """The places (n, d), and ln(error) and margins there (n, k), of those that were solved."""
    solved = [i for i, one in enumerate(tried) if one.error > 0]
    rows = [[math.log(tried[i].error), *tried[i].margins.values()] for i in solved]
    return places[solved], np.array(rows)
