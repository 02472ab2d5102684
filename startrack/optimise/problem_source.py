"""Problem, ledger -> inputs of the engines: forecasts, trials, costs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from startrack.core import Advance, Flags, Floats, Refused, Rows, software
from startrack.metrics import DisplayUnit
from startrack.optimise.evaluate import (
    LOST,
    MOST_EXCESS,
    NOTHING,
    PENALTY,
    Evaluation,
    Foresight,
    missed,
)
from startrack.optimise.forecast import bounded
from startrack.optimise.ledger import FORECAST, Ledger
from startrack.problem import Bounds, Margin, Problem, run_problem


@dataclass(frozen=True, eq=False)
class ProblemSource:
    """The designs of a problem, by their forecasts and trials.

    A study is deterministic: restarted with the ledger of an interrupted run, it does only the
    missing work and has the same result.

    seed      seed of random proposals, and of trials
    executor  computes forecasts and trials; None: this process
    ledger    keeps both
    watch     called with the values of each design and its forecast, when it is computed
    """

    problem: Problem
    seed: int = 1
    executor: Executor | None = None
    ledger: Ledger = field(default_factory=Ledger)
    watch: Callable[[Mapping[str, float], Foresight], None] | None = None

    @cached_property
    def variables(self) -> Sequence[Bounds]:
        """Variables of a search. Raises Refused if there is none, or a range is empty."""
        every = list(self.problem.variables)
        if not every:
            raise Refused("variables must name at least one parameter, got none")
        for variable in every:
            variable.check()
        return every

    @property
    def names(self) -> Sequence[str]:
        """Names of the variables."""
        return [variable.name for variable in self.variables]

    @property
    def search(self) -> str:
        """The setting of the search."""
        return self.problem.settings.search

    @property
    def precision(self) -> float:
        """The setting of the search."""
        return self.problem.settings.precision

    @property
    def margin(self) -> float:
        """The setting of the search."""
        return self.problem.settings.margin

    @property
    def span(self) -> float:
        """The setting of the search."""
        return self.problem.settings.span

    @property
    def laws(self) -> Mapping[str, str]:
        """None: all is known."""
        return {}

    def log_prior(self, points: Floats) -> Floats:
        """Zero: variables are uniform on their scale."""
        return np.zeros(len(points))

    @property
    def unit(self) -> DisplayUnit:
        """Unit of the objective."""
        return DisplayUnit(self.problem.text().unit, 1.0, 1.0)

    @property
    def conditions(self) -> Mapping[str, float]:
        """None: a problem is forecast in all of its conditions at once."""
        return {}

    @property
    def rooms(self) -> Mapping[str, float]:
        """None: all margins are parts of their limits."""
        return {}

    @property
    def start(self) -> Floats:
        """Unit-cube coordinates of the problem's present values, moved to the bounds if outside."""
        return np.array([variable.place(variable.start) for variable in self.variables])

    @property
    def start_values(self) -> dict[str, float]:
        """Present values of the problem's variables, SI."""
        return {variable.name: variable.start for variable in self.variables}

    def values(self, point: Floats) -> dict[str, float]:
        """Values of the variables, SI."""
        pairs = zip(self.variables, np.clip(point, 0, 1).tolist(), strict=True)
        return {variable.name: variable.value(place) for variable, place in pairs}

    def value(self, point: Floats, name: str) -> float:
        """Value of a variable in the design, SI."""
        return {own.name: own.start for own in self.design(point).variables}[name]

    def shown(self, point: Floats | None = None) -> dict[str, str]:
        """Values and units as texts, at a point; None: the present values of the problem."""
        values = self.start_values if point is None else self.values(point)
        return {variable.name: variable.shown(values[variable.name]) for variable in self.variables}

    def labels(self) -> dict[str, str]:
        """The variables as they are called in tables."""
        return {name: name for name in self.names}

    def costs(self, point: Floats) -> dict[str, float]:
        """Costs that have a margin, by their names with units."""
        costs = self.design(point).costs().items()
        return {f"{name} ({margin.unit})": margin.value for name, margin in costs}

    def design(self, point: Floats) -> Problem:
        """The problem at a point. Raises Refused if the problem contradicts itself there."""
        return self.problem.replaced(self.values(point))

    @cached_property
    def whole(self) -> Flags:
        """Flags by the bounds of the variables."""
        return np.array([variable.whole for variable in self.variables])

    def snapped(self, point: Floats) -> Floats:
        """The point with integers rounded as in the design at this point."""
        if not self.whole.any():
            return point
        values = self.values(point)
        places = [variable.place(values[variable.name]) for variable in self.variables]
        return np.where(self.whole, places, point)

    def foresee(self, points: Sequence[Floats], enough: float) -> list[Foresight]:
        """Forecasts of designs; none where costs miss their limits by more than MOST_EXCESS."""
        return self._foreseen(points, MOST_EXCESS)

    def foresee_any(
        self, points: Sequence[Floats], weighted: bool = False, progress: Advance | None = None
    ) -> list[Foresight]:
        """Forecasts of designs, without limits of cost."""
        return self._foreseen(points, math.inf, progress)

    def _foreseen(
        self, points: Sequence[Floats], most_excess: float, progress: Advance | None = None
    ) -> list[Foresight]:
        """Forecasts from the ledger; workers compute those that it lacks."""
        designs = [self._built(point) for point in points]
        keys = [
            self._key(design, f"forecast {most_excess}") if design else b"" for design in designs
        ]
        notes = {key: self.ledger.note(FORECAST, key) for key in keys if key}
        new = {key: design for key, design in zip(keys, designs, strict=True) if key and design}
        new = {key: design for key, design in new.items() if not notes[key]}
        if progress and len(keys) > len(new):
            progress(len(keys) - len(new))
        places = dict(zip(keys, points, strict=True))
        for key in (key for key in places if key and notes[key]):
            self._show(places[key], Foresight.read(notes[key]))
        call = partial(foreseen, most_excess=most_excess)
        every = list(new.values())
        results = self.executor.map(call, every) if self.executor else map(call, every)
        for key, foresight in zip(new, results, strict=True):
            notes[key] = foresight.text()
            self._show(places[key], foresight)
            if foresight.lasting:
                self.ledger.keep_note(FORECAST, key, notes[key])
            if progress:
                progress(1)
        return [Foresight.read(notes[key]) if key else NOTHING for key in keys]

    def _show(self, point: Floats, foresight: Foresight) -> None:
        if self.watch:
            self.watch(self.values(point), foresight)

    def _built(self, point: Floats) -> Problem | None:
        """The problem at a point; None where it contradicts itself."""
        try:
            return self.design(point)
        except Refused:
            return None

    def complete(self, point: Floats, known: Foresight) -> Foresight:
        """The forecast of a design, unchanged: it has all conditions."""
        return known

    def cost_missed(self, point: Floats) -> float:
        """Sum of the excesses of costs over their limits."""
        return missed(relative(self.design(point).costs()))

    def rows(
        self, design: Problem, count: int, first: int = 0, progress: Advance | None = None
    ) -> Rows:
        """Rows of the trials first ... first + count - 1 of a design."""

        def make(done: int, number: int) -> Rows:
            begin = first + done
            numbers = range(begin, begin + number)
            return run_problem(design, self.seed, numbers, self.executor, progress)

        key = self._key(design, f"trials {first}")
        return self.ledger.completed(key, count, make, design.columns)

    def evaluate(
        self, point: Floats, known: Foresight, trials: int | None = None, correction: float = 0.0
    ) -> Evaluation:
        """A design by its forecast and trials.

        known       its forecast
        trials      number of trials; None: the largest number for one of the best designs
        correction  correction of ln(objective)
        Returns     an evaluation; its note is the reason if a design cannot be built or tried
        """
        name, values = tuple(point.tolist()), self.values(point)
        try:
            design = self.design(point)
            rows = self.rows(design, trials or self.problem.settings.most_trials)
            judged, costs = design.judge(rows), relative(design.costs())
        except Refused as reason:
            nothing = math.nan, math.nan, LOST + PENALTY, dict[str, float](), None
            return Evaluation(name, values, *nothing, str(reason))
        measured = relative({name: margins[0] for name, margins in judged.margins.items()})
        margins = costs | measured
        return Evaluation(
            coordinates=name,
            values=values,
            error=judged.value.value,
            expected=math.exp(known.expected),
            score=known.expected + correction + PENALTY * missed(margins),
            margins=margins,
            summary=None,
            note="",
            forecast={name: known.margins[name] for name in measured.keys() & known.margins},
            tried=len(rows),
        )

    def _key(self, design: Problem, what: str) -> bytes:
        text = f"{software()} {self.seed} {what} {type(design).__qualname__} {design.described()}"
        return hashlib.blake2b(text.encode(), digest_size=16).digest()


def relative(margins: Mapping[str, Margin]) -> dict[str, float]:
    """Margins as parts of their limits."""
    return bounded({name: margin.relative for name, margin in margins.items()})


def foreseen(problem: Problem, most_excess: float = MOST_EXCESS) -> Foresight:
    """Forecast of a problem; NOTHING if the problem contradicts itself.

    most_excess  largest excess of costs for which a forecast is computed
    """
    try:
        costs = relative(problem.costs())
        if missed(costs) > most_excess:
            return Foresight(math.nan, costs)
        expected = problem.expect()
    except Refused as error:
        return NOTHING._replace(lasting=error.lasting)
    if not (expected.value > 0 and math.isfinite(expected.value)):
        return NOTHING
    return Foresight(math.log(expected.value), costs | relative(expected.margins))
