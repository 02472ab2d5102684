"""Function over the unit cube -> the point of its least value (nlopt)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import nlopt
import numpy as np

from startrack import core
from startrack.core import POSITIVE, Floats, Parameters, Range, Refused, parameter, printed

CODE = "searches"  # group of user code
REFUSED = 1e6  # score for nlopt of a point without a score; chosen by hand: above all others
# Calls per evaluation after which a search that repeats points ends. Chosen by hand: a repeated
# call takes microseconds.
REPEATS = 10


class Algorithm(StrEnum):
    """Algorithm of a search, by its name in nlopt.

    SBPLX              Rowan (1990): Nelder-Mead on subspaces; uses only comparisons, so
                       that it tolerates noise, kinks and points without a score
    BOBYQA             Powell (2009): a quadratic, for smooth functions; COBYLA (1994): linear
    DIRECT, CRS, MLSL  the whole cube: Gablonsky and Kelley (2001), Kaelo and Ali (2006), Kucherenko
                       and Sytsko (2005) with SBPLX for its descents
    """

    SBPLX = "LN_SBPLX"
    BOBYQA = "LN_BOBYQA"
    COBYLA = "LN_COBYLA"
    DIRECT = "GN_DIRECT_L"
    CRS = "GN_CRS2_LM"
    MLSL = "G_MLSL_LDS"


def algorithms(text: str) -> list[str]:
    """Names of the algorithms of a campaign, which run in this order: "direct+sbplx", "GN_ISRES".

    User code is named as module:function.

    Raises  Refused if nlopt has no algorithm of that name, or only one that needs a gradient.
    """
    names = list[str]()
    for part in text.split("+"):
        if core.is_code(part):
            names.append(part.strip())
            continue
        name = part.strip().upper()
        name = Algorithm[name].value if name in Algorithm.__members__ else name
        if not (name.startswith(("LN_", "GN_", "G_")) and hasattr(nlopt, name)):
            short = ", ".join(member.lower() for member in Algorithm.__members__)
            raise Refused(
                f"campaign.search must be emulator, or algorithms joined by +: {short}, or names "
                f"of nlopt that begin with LN_ or GN_, or code as module:function, got {text!r}"
            )
        names.append(name)
    return names


class Search(Parameters):
    """Length and precision of a search.

    algorithm    name in nlopt, or user code as module:function
    evaluations  largest number of points that are evaluated
    first_step   1, side of the first simplex, in the unit cube
    last_step    1, step length below which a local search ends
    seed         of algorithms that draw random numbers
    """

    algorithm: str = Algorithm.SBPLX
    evaluations: int = parameter(limit=Range(1, 10**7), default=200)
    first_step: float = parameter(limit=Range(1e-9, 0.5), default=0.15)
    last_step: float = parameter(limit=POSITIVE, default=2e-3)
    seed: int = parameter(limit=Range(0, 2**32 - 1), default=0)


@dataclass(frozen=True, eq=False)
class SearchInput:
    """Input of a user's search. The best point that the search evaluates is its result.

    score        function of a point (d,) of the unit cube, to be minimised; infinite where a design
                 has no attitude or cannot be built. The score of a repeated point is cached
    start        (d,), in the unit cube
    evaluations  largest number of points; one more evaluation ends the search
    generator    of random numbers
    """

    score: Callable[[Floats], float]
    start: Floats
    evaluations: int
    generator: np.random.Generator


@printed
@dataclass(frozen=True, eq=False)
class SearchResult:
    """Result of a search.

    coordinates  (d,) of the best point; the start where no point has a score
    score        there; infinite where no point has a score
    evaluations  number of points that were evaluated
    ending       one sentence
    """

    coordinates: Floats
    score: float
    evaluations: int
    ending: str


def minimise(
    score: Callable[[Floats], float],
    start: Floats,
    search: Search,
    enough: Callable[[], str] | None = None,
) -> SearchResult:
    """Minimise a function over the unit cube, and return the best point that was evaluated.

    What this adds to nlopt: `score` gets a copy of each point. A score that is not finite counts as
    refused. No point is evaluated twice. The limit on evaluations also stops algorithms of nlopt
    that would exceed it. The best point is stored here, so that rounding errors and an early end
    do not lose it.

    score    of a point (d,); NaN or infinite where the point has no score
    start    (d,), in the unit cube
    enough   called after each evaluation; where it returns a sentence, the search ends
    Raises   the exceptions of `score`; Refused if the start is outside the cube.
    """
    if not ((start >= 0) & (start <= 1)).all():
        raise Refused(f"start must lie in the unit cube, got {start}")
    watch = _Watch(score, start, search.evaluations, enough)
    ending = "nlopt converged"
    try:
        if core.is_code(search.algorithm):
            ending = _by_code(watch, start, search)
            return SearchResult(watch.coordinates, watch.best, len(watch.seen), ending)
        engine = _engine(search, start)
        engine.set_min_objective(watch)
        engine.optimize(np.array(start, float))
        ending = {
            nlopt.MAXEVAL_REACHED: "all evaluations were used",
            nlopt.XTOL_REACHED: "the steps became too small to matter",
        }.get(engine.last_optimize_result(), ending)
    except _Enough as reason:
        ending = str(reason)
    except nlopt.RoundoffLimited:
        ending = "rounding errors stopped nlopt"
    except (nlopt.ForcedStop, nlopt.runtime_error, nlopt.invalid_argument) as error:
        if not watch.seen:
            raise Refused(f"nlopt refused to search: {error}") from None
        ending = "nlopt gave up"
    return SearchResult(watch.coordinates, watch.best, len(watch.seen), ending)


def _by_code(watch: _Watch, start: Floats, search: Search) -> str:
    """Run a search of user code. Returns why it ended."""

    def score(point: Floats) -> float:
        at = np.asarray(point, float)
        if at.shape != start.shape or not np.isfinite(at).all():
            raise ValueError(
                f"a point must be {len(start)} finite numbers, got {core.shown(point)}"
            )
        value = watch(at, np.empty(0))
        return value if value < REFUSED else math.inf

    random = core.Streams(search.seed, 0)("search by code")
    given = SearchInput(score, start.copy(), search.evaluations, random)
    core.call_code(CODE, search.algorithm, given)
    return f"{search.algorithm} converged"


def minimise_globally(
    score: Callable[[Floats], float],
    start: Floats,
    wide: int,
    near: int,
    enough: Callable[[], str] | None = None,
) -> SearchResult:
    """Minimise a function over the whole cube by DIRECT, then around the best point by Sbplx.

    wide, near  evaluations of each search
    Returns     result of the last search, which is never worse than the start
    """
    here = minimise(score, start, Search(evaluations=1), enough)
    if enough and enough():
        return here
    far = minimise(score, start, Search(Algorithm.DIRECT, wide), enough)
    if enough and enough():
        return far
    best = min(far, here, key=lambda end: end.score)
    return minimise(score, best.coordinates, Search(evaluations=near), enough)


SMOOTH_STEP = 1e-5  # below which the search of a smooth function ends
SMOOTH_EVALUATIONS = 200
SMOOTH_TOLERANCE = 1e-6  # tolerance of a limit


def minimise_smooth(
    score: Callable[[Floats, Floats], float],
    limits: Sequence[Callable[[Floats, Floats], float]],
    start: Floats,
    bounds: tuple[Floats, Floats],
) -> Floats:
    """Minimise a smooth function under smooth limits, by nlopt's SLSQP (Kraft 1994).

    score    score of a point (d,); writes the gradient to its second argument, unless it is empty
    limits   functions like `score`; met where the value is not positive
    bounds   lowest and highest coordinates, (d,) each
    Returns  the last point (d,); the start where nlopt fails
    """
    engine = nlopt.opt(nlopt.LD_SLSQP, len(start))
    engine.set_lower_bounds(bounds[0])
    engine.set_upper_bounds(bounds[1])
    engine.set_min_objective(score)
    for limit in limits:
        engine.add_inequality_constraint(limit, SMOOTH_TOLERANCE)
    engine.set_xtol_abs(np.full(len(start), SMOOTH_STEP))
    engine.set_maxeval(SMOOTH_EVALUATIONS)
    try:
        return np.clip(engine.optimize(start), *bounds)
    except (nlopt.RoundoffLimited, nlopt.runtime_error):
        return start


def minimise_within_limits(
    value: Callable[[Floats], float],
    limits: Sequence[Callable[[Floats], float]],
    start: Floats,
    search: Search,
) -> None:
    """Minimise a nearly smooth function over the unit cube within limits, by nlopt's COBYLA.

    `value` must store the best point: nothing is returned. Source: Powell (1994).

    value   of a point (d,), finite
    limits  functions like `value`; met where the value is not positive
    search  gives the evaluations and the steps
    """
    engine = nlopt.opt(nlopt.LN_COBYLA, len(start))
    engine.set_lower_bounds(0.0)
    engine.set_upper_bounds(1.0)
    engine.set_min_objective(lambda point, _: value(point))
    for limit in limits:
        engine.add_inequality_constraint(
            lambda point, _, limit=limit: limit(point), SMOOTH_TOLERANCE
        )
    engine.set_initial_step(search.first_step)
    engine.set_xtol_abs(np.full(len(start), search.last_step))
    engine.set_maxeval(search.evaluations)
    with suppress(nlopt.RoundoffLimited, nlopt.runtime_error):
        engine.optimize(start)


class _Enough(BaseException):
    """Raised through nlopt, or through user code, to end the search."""


class _Watch:
    """The objective function for nlopt, which keeps the score of each point."""

    def __init__(
        self,
        score: Callable[[Floats], float],
        start: Floats,
        most: int,
        enough: Callable[[], str] | None,
    ) -> None:
        self.seen = dict[bytes, float]()
        self.coordinates, self.best = np.array(start, float), math.inf
        self._score, self._most, self._enough = score, most, enough
        self._calls = 0

    def __call__(self, buffer: Floats, _gradient: Floats) -> float:
        coordinates = np.clip(np.array(buffer, float), 0, 1)  # nlopt uses its buffer again
        key = coordinates.tobytes()
        self._calls += 1
        if self._calls > REPEATS * self._most:
            raise _Enough("the search repeated its points")
        if key not in self.seen:
            if len(self.seen) >= self._most:
                raise _Enough("all evaluations were used")
            self.seen[key] = self._try(coordinates)
            if self._enough and (reason := self._enough()):
                raise _Enough(reason)
        return self.seen[key]

    def _try(self, coordinates: Floats) -> float:
        value = float(self._score(coordinates.copy()))
        if not math.isfinite(value):
            return REFUSED
        if value < self.best:
            self.coordinates, self.best = coordinates, value
        return value


def _engine(search: Search, start: Floats) -> Any:
    # nlopt has one generator per thread, not per search: simultaneous searches need two threads.
    nlopt.srand(search.seed)
    engine = nlopt.opt(getattr(nlopt, search.algorithm), len(start))
    engine.set_lower_bounds(np.zeros(len(start)))
    engine.set_upper_bounds(np.ones(len(start)))
    engine.set_maxeval(search.evaluations)
    if search.algorithm == Algorithm.MLSL:
        local = nlopt.opt(nlopt.LN_SBPLX, len(start))
        local.set_xtol_abs(np.full(len(start), search.last_step))
        engine.set_local_optimizer(local)
    elif search.algorithm.startswith("LN_"):
        engine.set_xtol_abs(np.full(len(start), search.last_step))
        step = search.first_step
        engine.set_initial_step(np.where(start + step <= 1, step, -step))
    return engine
