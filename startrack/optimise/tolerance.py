"""Designs around a design -> tolerance of each variable, by emcee on a quadratic surface."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy import special

from startrack.core import Advance, Floats, Refused, printed
from startrack.optimise.ensemble import Chains, draw, thinned
from startrack.optimise.evaluate import Evaluation, Foresight
from startrack.optimise.source import StudiedSource


@dataclass(frozen=True, eq=False)
class ErrorSurface:
    """Least-squares quadratic of one or more results over the variables.

    coefficients  (terms, k)
    error         (k,) root mean square of the leave-one-out residuals
    """

    coefficients: Floats
    error: Floats

    def __call__(self, coordinates: Floats) -> Floats:
        """The results (n, k) at points (n, d)."""
        return _terms(coordinates) @ self.coefficients


def fit_surface(coordinates: Floats, result: Floats) -> ErrorSurface:
    """Fit a quadratic.

    coordinates  (n, d) in [-1, 1]
    result       (n, k)
    Raises       ValueError if there are no more points than the quadratic has terms.
    """
    terms = _terms(coordinates)
    if len(coordinates) <= terms.shape[1]:
        raise Refused(
            f"a quadratic in {coordinates.shape[1]} variables needs more than {terms.shape[1]} "
            f"designs, got {len(coordinates)}"
        )
    coefficients = np.asarray(np.linalg.lstsq(terms, result, rcond=None)[0], float)
    q, _ = np.linalg.qr(terms)
    leverage = np.minimum((q**2).sum(axis=1), 1 - 1e-9)
    left_out = (result - terms @ coefficients) / (1 - leverage)[:, None]
    return ErrorSurface(coefficients, np.asarray(np.sqrt(np.mean(left_out**2, axis=0)), float))


def terms_needed(dimensions: int) -> int:
    """Number of coefficients of a quadratic."""
    return (dimensions + 1) * (dimensions + 2) // 2


def _terms(coordinates: Floats) -> Floats:
    n, d = coordinates.shape
    i, j = np.triu_indices(d)
    return np.column_stack([np.ones(n), coordinates, coordinates[:, i] * coordinates[:, j]])


# Chosen by hand: more designs reduce the surface's error and cost trials in proportion.
DESIGNS_PER_TERM = 2.5
CHECKS = 12  # designs that check the surface; chosen by hand, as above
START_WIDTH = 0.3  # half width, over the region's, of the box where walkers start; chosen by hand
LEAST_ERROR = 1e-6  # least error of a surface, so that an exact fit has a finite density


@printed
@dataclass(frozen=True, eq=False)
class Tolerance:
    """The designs around a centre that keep the error under a limit.

    source         the variables
    chains         unit-cube coordinates, drawn in proportion to the probability that the design
                   meets the limit and the requirements
    limit          largest objective that is allowed, SI
    surface_error  ln(objective), leave-one-out error of the response surface
    check_error    ln(objective), rms difference to the forecast at designs of the region that are
                   not in the fit
    expected       1, mean probability by the surface that these designs meet the limit and the
                   requirements
    kept           1, fraction of these designs that meet them by the forecast
    checks         number of these designs
    centre         evaluation of the centre by trials, which correct the forecasts
    designs        number of all forecast designs
    """

    source: StudiedSource
    chains: Chains
    limit: float
    surface_error: float
    check_error: float
    expected: float
    kept: float
    checks: int
    centre: Evaluation
    designs: int

    @property
    def samples(self) -> Floats:
        """(n, d) unit-cube coordinates."""
        return self.chains.flat


def sample(source: StudiedSource, watch: Advance | None = None) -> Tolerance:
    """Sample the tolerance region around a design.

    1. Designs of a Latin hypercube around the design are forecast; trials of the design itself
       correct the forecasts.
    2. A quadratic surface is fitted to ln(objective) and to each margin.
    3. emcee (Foreman-Mackey et al. 2013, PASP 125, 306) samples the density below.
    4. Some designs of the samples are forecast to check the surface.

        p(design) ~ p_0(design) P(ln objective <= ln limit) * prod_i P(margin_i >= 0)

    The errors of the surfaces have normal distributions. The prior p_0 has the laws of the unknown
    values of the design, and is uniform in all other variables.

    watch     called with the number of designs that were just forecast, or that were known
    Raises    Refused if there are no variables, or the design expects no attitude.
    Accuracy  model: a quadratic surface, whose error is measured in two ways and is part of the
              result; the error of a forecast that differs from that of the centre is not corrected.
    """
    start, d = source.start, len(source.names)
    low, high = np.maximum(start - source.span, 0), np.minimum(start + source.span, 1)
    rng = np.random.default_rng(source.seed)
    cube = scipy.stats.qmc.LatinHypercube(d, rng=rng).random(designs_needed(d) - CHECKS)
    cube[0] = (start - low) / (high - low)

    def forecast(points: Floats) -> list[Foresight]:
        return source.foresee_any(list(low + (high - low) * points), progress=watch)

    first = forecast(cube[:1])
    if first[0].reason:
        raise Refused(f"the design must work to be sampled around: {first[0].reason}")
    foresights = first + forecast(cube[1:])
    centre = source.evaluate(start, foresights[0])
    if not (centre.error > 0 and centre.expected > 0):
        raise Refused(f"the design must work to be sampled around: {centre.note or 'unsolved'}")
    shift = _shift(centre, foresights[0])
    at, results = _results(2 * cube - 1, foresights, shift)
    # A margin that is the same for all designs needs no surface.
    moving = np.ptp(results, axis=0) > 0
    if (results[0, 1:][~moving[1:]] < 0).any():
        raise Refused("the design misses a requirement that no variable changes")
    surface = fit_surface(at, results[:, moving])
    limit = math.log(centre.error) + math.log1p(source.margin)
    region = region_of(surface, limit)

    def to_cube(points: Floats) -> Floats:
        return np.asarray(low + (high - low) * (points + 1) / 2)

    def log_probability(points: Floats) -> Floats:
        return region(points) + source.log_prior(to_cube(points))

    def middle(rng: np.random.Generator, n: int) -> Floats:
        return START_WIDTH * rng.uniform(-1, 1, (n, d))

    chains = draw(log_probability, middle, source.seed, ledger=source.ledger)
    picks = thinned(chains.flat, CHECKS)
    at, truth = _results(picks, forecast((picks + 1) / 2), shift)
    difference = surface(at)[:, 0] - truth[:, 0] if len(at) else np.array([np.nan])
    kept = (truth[:, 0] <= limit) & (truth[:, 1:] >= 0).all(axis=1)
    return Tolerance(
        source=source,
        chains=replace(chains, samples=to_cube(chains.samples)),
        limit=math.exp(limit),
        surface_error=float(surface.error[0]),
        check_error=float(np.sqrt(np.mean(difference**2))),
        expected=float(np.exp(region(picks)).mean()),
        kept=float(kept.sum() / len(picks)),
        checks=len(at),
        centre=centre,
        designs=designs_needed(d),
    )


def _shift(centre: Evaluation, foresight: Foresight) -> Floats:
    """Trials of the centre minus its forecast: ln(objective), and each margin that both have.

    The objective of the surface is in SI, like the objective of the trials.
    """
    apart = [centre.margins[name] - margin for name, margin in foresight.margins.items()]
    return np.array([math.log(centre.error) - foresight.expected, *apart])


def designs_needed(dimensions: int) -> int:
    """Number of designs that `sample` forecasts, to fit the surface and to check it."""
    return 1 + math.ceil(DESIGNS_PER_TERM * terms_needed(dimensions)) + CHECKS


def region_of(surface: ErrorSurface, limit: float) -> Callable[[Floats], Floats]:
    """Log-probability that designs (n, d) in [-1, 1] keep the limit and the margins."""
    error = np.maximum(surface.error, LEAST_ERROR)

    def log_probability(points: Floats) -> Floats:
        predicted = surface(points)
        score = special.log_ndtr((limit - predicted[:, 0]) / error[0])
        score += special.log_ndtr(predicted[:, 1:] / error[1:]).sum(axis=1)
        return np.where((np.abs(points) <= 1).all(axis=1), score, -np.inf)

    return log_probability


def _results(points: Floats, foresights: list[Foresight], shift: Floats) -> tuple[Floats, Floats]:
    """Coordinates (n, d), and ln(objective) and margins (n, k), of designs that have a forecast.

    shift  (k,) is added to each
    """
    solved = [i for i, foresight in enumerate(foresights) if math.isfinite(foresight.expected)]
    rows = [[foresights[i].expected, *foresights[i].margins.values()] for i in solved]
    return points[solved], np.array(rows).reshape(len(rows), -1) + shift
