"""emcee on the designs that meet the requirement: how far each parameter may stray."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.stats import qmc

from startrack.case import Case
from startrack.study.box import Box
from startrack.study.campaign import Campaign
from startrack.study.optimize import Evaluation, evaluate
from startrack.study.surface import Surface, fit, terms_needed

Floats = NDArray[np.float64]

DESIGNS_PER_TERM = 2.5
CHECKS = 12
WALKERS = 40
STRETCH = 4000  # steps between two looks at the convergence
MOST_STEPS = 40_000
LONG_ENOUGH = 50  # autocorrelation times, emcee's own rule


@dataclass(frozen=True, eq=False)
class Tolerance:
    """The designs around a centre that keep the error under a limit.

    box              the variables
    samples          (n, d) places in the box's unit cube, drawn in proportion to the probability
                     that the design meets the limit and the requirements
    limit            radian, rms error that must be kept
    surface_error    ln(rms), leave-one-out error of the response surface
    check_error      ln(rms), rms difference to Monte Carlo at designs of the region that the
                     surface has not seen
    checks           how many of these designs there were
    acceptance       share of accepted moves
    autocorrelation  steps, the longest over the variables
    effective        independent samples, walkers * steps / autocorrelation
    evaluations      all designs that were tried
    """

    box: Box
    samples: Floats
    limit: float
    surface_error: float
    check_error: float
    checks: int
    acceptance: float
    autocorrelation: float
    effective: float
    evaluations: tuple[Evaluation, ...]

    @property
    def converged(self) -> bool:
        """Whether the chains are at least 50 autocorrelation times long."""
        return self.effective >= LONG_ENOUGH * WALKERS


def sample(
    case: Case,
    campaign: Campaign,
    seed: int,
    executor: Executor,
    workers: int = 1,
    watch: Callable[[Evaluation], None] | None = None,
) -> Tolerance:
    """Sample the tolerance region around a design.

    Monte Carlo at designs of a Latin hypercube in a box around the case; a quadratic through
    ln(rms) and through each margin; emcee (Foreman-Mackey et al. 2013, PASP 125, 306) on

        p(design) ~ P(ln rms <= ln limit) * prod_i P(margin_i >= 0)

    with normal laws of the surfaces' own errors. The density is a function, not a Monte Carlo, so
    that the sampler sees no noise.

    Errors  ValueError where the campaign names no variables or the centre meets no requirement.
            model: a quadratic; its error is in the result, measured twice.
    """
    box = Box(case, campaign.variables)
    campaign = replace(campaign, trials=campaign.sample_trials)
    d = len(box)
    low = np.maximum(box.start - campaign.span, 0)
    high = np.minimum(box.start + campaign.span, 1)
    cube = qmc.LatinHypercube(d, rng=np.random.default_rng(seed)).random(designs_needed(d) - CHECKS)
    cube[0] = (box.start - low) / (high - low)
    evaluations = []

    def measure(places: Floats) -> tuple[Floats, Floats]:
        """Places in [-1, 1], and ln(rms) and margins there, of the designs that were solved."""
        kept, results = [], []
        for u in places:
            done = evaluate(box, campaign, low + (high - low) * u, seed, executor, workers)
            evaluations.append(done)
            if watch:
                watch(done)
            if math.isfinite(done.rms(campaign.objective)):
                kept.append(2 * u - 1)
                results.append([math.log(done.rms(campaign.objective)), *done.margins.values()])
        return np.array(kept), np.array(results)

    at, results = measure(cube)
    if not len(at) or evaluations[0].summary is None:
        raise ValueError(f"the design must work to be sampled around: {evaluations[0].note}")
    surface = fit(at, results)
    limit = results[0, 0] + math.log1p(campaign.margin)
    sampler, autocorrelation = _walk(surface, limit, d, seed)
    burn_in = sampler.iteration // 5
    chain = sampler.get_chain(discard=burn_in, flat=True)
    picks = chain[np.linspace(0, len(chain) - 1, CHECKS).astype(int)]
    checked, truth = measure((picks + 1) / 2)
    difference = surface(checked)[:, 0] - truth[:, 0] if len(checked) else np.array([np.nan])
    return Tolerance(
        box,
        low + (high - low) * (chain + 1) / 2,
        math.exp(limit),
        float(surface.error[0]),
        float(np.sqrt(np.mean(difference**2))),
        len(checked),
        float(np.mean(sampler.acceptance_fraction)),
        autocorrelation,
        WALKERS * (sampler.iteration - burn_in) / autocorrelation,
        tuple(evaluations),
    )


def designs_needed(dimensions: int) -> int:
    """How many designs `sample` tries: those for the surface and those that check it."""
    return 1 + math.ceil(DESIGNS_PER_TERM * terms_needed(dimensions)) + CHECKS


def _walk(surface: Surface, limit: float, d: int, seed: int) -> tuple[emcee.EnsembleSampler, float]:
    """Run the ensemble in [-1, 1]^d from the centre until it is long enough.

    Returns  the sampler, and the longest autocorrelation time in steps
    """
    error = np.maximum(surface.error, 1e-6)

    def log_probability(places: Floats) -> Floats:
        predicted = surface(places)
        score = special.log_ndtr((limit - predicted[:, 0]) / error[0])
        score += special.log_ndtr(predicted[:, 1:] / error[1:]).sum(axis=1)
        return np.where((np.abs(places) <= 1).all(axis=1), score, -np.inf)

    state = np.random.RandomState(np.random.MT19937(np.random.SeedSequence((seed, d))))
    sampler = emcee.EnsembleSampler(WALKERS, d, log_probability, vectorize=True)
    start = emcee.State(0.2 * state.uniform(-1, 1, (WALKERS, d)), random_state=state.get_state())
    while True:
        start = sampler.run_mcmc(start, STRETCH)
        kept = 0.8 * sampler.iteration
        autocorrelation = float(
            np.max(sampler.get_autocorr_time(discard=sampler.iteration // 5, tol=0))
        )
        if kept > LONG_ENOUGH * autocorrelation or sampler.iteration >= MOST_STEPS:
            return sampler, autocorrelation
