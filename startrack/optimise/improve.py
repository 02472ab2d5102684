"""Problem -> a better problem: forecasts, trials that correct them, fresh trials that decide."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from startrack.core import Floats, Refused, Rows, printed
from startrack.metrics import Interval
from startrack.optimise import steps
from startrack.optimise.correction import Correction
from startrack.optimise.evaluate import Evaluation, Foresight, missed
from startrack.optimise.explorer import Explorer
from startrack.optimise.landscape import Landscape
from startrack.optimise.ledger import Ledger
from startrack.optimise.limit import Limit
from startrack.optimise.problem_source import ProblemSource, relative
from startrack.optimise.runner import FRESH
from startrack.optimise.search import minimise_globally
from startrack.problem import (
    Expectation,
    Judgement,
    Margin,
    Problem,
    SearchSettings,
    compare_problems,
)

# Probability, over all rounds, that a design at the search's target is wrongly accepted for a
# limit. The verdicts are by the problem's own intervals.
TAIL = 0.05


@printed
@dataclass(frozen=True)
class Improved:
    """Result of the search of a problem.

    If no design is better than the start, `best` is the start, and the factor is 1.

    start, best    values of the variables, SI
    problem        the best
    judged         start and best on fresh trials that no tuning used
    costs          margins of the best that need no trials
    factor         objective of the start over the objective of the best, on the same trials, with
                   the interval of `compare_problems`
    verdicts       of the best: "met", "missed", or "not shown", by the names of limits
    expected       the best by formula
    evaluations    designs with trials, in order
    rounds         of fresh trials
    ending         why the search stopped
    apart          largest factor between trials and formula, of the designs that were tried
    landscape      ranges and prices around the best, by forecasts
    """

    start: dict[str, float]
    best: dict[str, float]
    problem: Problem
    judged: tuple[Judgement, Judgement]
    costs: dict[str, Margin]
    factor: Interval
    verdicts: dict[str, str]
    expected: Expectation
    evaluations: tuple[Evaluation, ...]
    rounds: int
    ending: str
    apart: float
    landscape: Landscape

    @property
    def feasible(self) -> bool:
        """Whether all limits are met, each by its own 95 % interval where trials decide."""
        return all(verdict == "met" for verdict in self.verdicts.values())


def improve(
    problem: Problem,
    seed: int = 1,
    executor: Executor | None = None,
    ledger: Ledger | None = None,
    watch: steps.Watch | None = None,
    watch_forecast: Callable[[Mapping[str, float], Foresight], None] | None = None,
) -> Improved:
    """Search the best values of a problem's variables.

    Emulators of the objective and of all margins are fitted to forecasts over the space, until no
    gain above the precision is expected. Trials of the best designs correct the forecasts. The best
    design is judged on fresh trials. If these miss a limit, they also correct the forecasts, and
    the search continues, in at most `steps.ROUNDS` rounds, each with its own fresh trials.

    executor  for forecasts and trials; None: this process
    ledger    keeps both, so that an interrupted search continues; None: it is in memory
    watch     called with each design that was tried
    watch_forecast  called with the values of each design and its forecast
    Raises    Refused if the problem has no variables, no design has a forecast, or none meets
              the limits on costs.
    """
    source = ProblemSource(problem, seed, executor, ledger or Ledger(), watch_forecast)
    explorer, settings = Explorer(source), problem.settings
    started = problem.replaced(source.values(source.start))
    explorer.limits = {
        name: Limit.of_error(None, settings.fresh_trials, TAIL / steps.ROUNDS)
        for name in started.expect().margins
    }
    steps.explore({"": explorer}, {"": affordable_start(source)}, settings)
    tried, judge = _Tried(explorer, source), _Fresh(source)
    last, rounds, ending = _rounds(explorer, settings, tried, source, judge, watch or _ignore)
    begin = tuple(source.start.tolist())
    first = last if last.point == begin else judge(begin, last.number)
    values, best = source.values(source.start), np.array(last.point)
    factor = judge.gain(first, last)
    if _rank(first) <= _rank(last):
        last, factor, best = first, Interval(1.0, 1.0, 1.0), source.start
        ending = f"{ending}; no design is better than the start, on fresh trials"
    return Improved(
        start=values,
        best=source.values(best),
        problem=last.problem,
        judged=(first.judged, last.judged),
        costs=last.costs,
        factor=factor,
        verdicts=last.verdicts,
        expected=last.problem.expect(),
        evaluations=tuple(tried.every),
        rounds=rounds,
        ending=ending,
        apart=_failed(tried.every),
        landscape=explorer.landscape(best),
    )


def _ignore(design: Evaluation) -> None:
    pass


def affordable_start(source: ProblemSource) -> Floats:
    """The start, or the nearest design that meets the limits on costs."""
    met = list[Floats]()

    def short(point: Floats) -> float:
        try:
            excess = source.cost_missed(point)
        except Refused:
            return math.nan
        if not excess:
            met.append(point)
        return excess

    end = minimise_globally(
        short,
        source.start,
        steps.START_EVALUATIONS,
        steps.START_EVALUATIONS,
        lambda: "met" if met else "",
    )
    if met:
        return met[0]
    if not math.isfinite(end.score):
        raise Refused("no design can be built within the ranges of the variables")
    costs = source.design(end.coordinates).costs()
    nearest = "; ".join(
        f"{name} ({margin.text})" for name, margin in costs.items() if margin.relative < 0
    )
    raise Refused(f"no design meets the limits on costs; the nearest misses {nearest}")


class _Tried:
    """Trials of designs by their numbers from 0 on."""

    def __init__(self, explorer: Explorer, source: ProblemSource) -> None:
        self._explorer, self._source = explorer, source
        self.every = list[Evaluation]()

    def __call__(
        self, point: Floats, trials: int | None, correction: Correction | None
    ) -> Evaluation:
        known = self._explorer.uncorrected_forecast(point)
        shift = correction(point) if correction else 0.0
        count = trials or self._source.problem.settings.trials
        done = self._source.evaluate(point, known, count, shift)
        if done.trials:
            self.every.append(done)
        return done


@dataclass(frozen=True, eq=False)
class _OnFresh:
    """A design on fresh trials."""

    point: tuple[float, ...]
    number: int  # of the round
    problem: Problem
    costs: dict[str, Margin]
    judged: Judgement
    verdicts: dict[str, str]
    trials: int


@dataclass(frozen=True, eq=False)
class _Fresh:
    source: ProblemSource

    def __call__(self, point: tuple[float, ...], number: int) -> _OnFresh:
        """A design on the fresh trials of a round."""
        problem = self.source.design(np.array(point))
        rows, costs = self._rows(problem, number), dict(problem.costs())
        judged = problem.judge(rows)
        return _OnFresh(
            point=point,
            number=number,
            problem=problem,
            costs=costs,
            judged=judged,
            verdicts=verdicts(costs, judged),
            trials=len(rows),
        )

    def gain(self, start: _OnFresh, best: _OnFresh) -> Interval:
        """Objective of the start over that of the best, on the trials of the best's round."""
        problems = best.problem, start.problem
        rows = [self._rows(problem, best.number) for problem in problems]
        return compare_problems(problems, (rows[0], rows[1]), self.source.seed)[0].ratio

    def _rows(self, problem: Problem, number: int) -> Rows:
        count = self.source.problem.settings.fresh_trials
        return self.source.rows(problem, count, FRESH + number * count)


def verdicts(costs: Mapping[str, Margin], judged: Judgement) -> dict[str, str]:
    """For each limit "met", "missed", or "not shown", where both are within the 95 % interval."""
    found = {name: "met" if margin.relative >= 0 else "missed" for name, margin in costs.items()}
    for name, (_, near, far) in judged.margins.items():
        if near.relative >= 0:
            found[name] = "met"
        else:
            found[name] = "missed" if far.relative < 0 else "not shown"
    return found


def _rounds(
    explorer: Explorer,
    settings: SearchSettings,
    try_design: _Tried,
    source: ProblemSource,
    judge: _Fresh,
    watch: steps.Watch,
) -> tuple[_OnFresh, int, str]:
    shown, results, ending = list[steps.FreshMargins](), list[_OnFresh](), ""
    # Trials of the start correct formulas that are too favourable for other designs.
    start = try_design(source.start, None, None)
    watch(start)
    tried = [start] if start.trials else []
    for number in range(steps.ROUNDS):
        left = max(settings.evaluations - len(tried), 1 + steps.FINALISTS)
        tried, ending = steps.refine(
            explorer, left, settings.most_trials, try_design, watch, tried, shown
        )
        before = {design.point for design in shown}
        new = _best_by_trials(tried, before)
        if new is None:
            break
        results.append(judge(new.coordinates, number))
        if all(verdict == "met" for verdict in results[-1].verdicts.values()):
            break
        found = {
            name: (margins[0].relative, results[-1].trials)
            for name, margins in results[-1].judged.margins.items()
        }
        shown.append(steps.FreshMargins(new.coordinates, found))
        explorer.correct_limits(steps.evidence_of(explorer, tried, shown))
        steps.resume(explorer)
    if not results:
        raise Refused(f"no design could be tried; the start says: {start.note}")
    return min(results, key=_rank), len(results), ending


def _best_by_trials(
    tried: Sequence[Evaluation], before: Collection[tuple[float, ...]]
) -> Evaluation | None:
    """Best of the designs with most trials, by these; None where all were shown before."""
    left = [design for design in tried if design.coordinates not in before and design.trials]
    most = max((design.trials for design in left), default=0)
    last = [design for design in left if design.trials == most]
    return min(last, key=lambda design: (missed(design.margins), design.error), default=None)


def _failed(tried: Sequence[Evaluation]) -> float:
    """The largest factor between trials and formula, of all designs that were tried."""
    ratios = [design.error / design.expected for design in tried if design.error > 0]
    return max((max(ratio, 1 / ratio) for ratio in ratios), default=1.0)


def _rank(shown: _OnFresh) -> tuple[float, float]:
    """Rank, least best: limits that are not met first, then the objective."""
    short = sum(max(0.0, -margins[0].relative) for margins in shown.judged.margins.values())
    short += missed(relative(shown.costs))
    value = shown.judged.value.value
    return short, value if math.isfinite(value) else math.inf
