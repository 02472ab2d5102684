"""Problem, two of its goals -> the designs that no other design beats in both."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from startrack.core import Floats, Refused
from startrack.metrics import Interval
from startrack.optimise.evaluate import Foresight
from startrack.optimise.explorer import Explorer
from startrack.optimise.improve import affordable_start
from startrack.optimise.pareto import Point, trade_off
from startrack.optimise.problem_source import ProblemSource
from startrack.optimise.runner import FRESH
from startrack.optimise.steps import SearchStage
from startrack.problem import Expectation, Judgement, Problem

OBJECTIVE = "objective"


@dataclass(frozen=True)
class ProblemGoals:
    """Two goals of a trade-off, both minimised.

    first, second  "objective", or the name of one of its parts or of an upper limit
    """

    problem: Problem
    first: str = OBJECTIVE
    second: str = "mass"

    def __post_init__(self) -> None:
        known = self.names(self.problem)
        for goal in (self.first, self.second):
            if goal not in known:
                raise Refused(f"a goal must be one of {', '.join(known)}, got {goal!r}")
        if self.first == self.second:
            raise Refused(f"first and second must differ, got {self.first} twice")

    @staticmethod
    def names(problem: Problem) -> list[str]:
        """Quantities that may be traded off."""
        limits = dict(problem.costs()) | dict(problem.expect().margins)
        most = (name for name, margin in limits.items() if margin.most)
        return list(dict.fromkeys([OBJECTIVE, *problem.text().parts, *most]))

    def unit(self, goal: str) -> str:
        """Unit of a goal, as a text."""
        words = self.problem.text()
        if goal == OBJECTIVE:
            return words.unit
        if goal in words.parts:
            return words.parts[goal][1]
        costs = self.problem.costs()
        return (costs[goal] if goal in costs else self.problem.expect().margins[goal]).unit

    def title(self, goal: str) -> str:
        """A goal in words."""
        words = self.problem.text()
        if goal == OBJECTIVE:
            return words.value
        return words.parts[goal][0] if goal in words.parts else goal


def problem_front(
    source: ProblemSource,
    goals: ProblemGoals,
    points: int = 7,
    method: str = "epsilon",
    watch: Callable[[SearchStage], None] | None = None,
) -> list[Point]:
    """Pareto front of both goals by forecast, as `front` finds it; trials then measure each point.

    Returns  the points that are not dominated by the forecasts, in order of the first
    Raises   Refused if no design meets the limits.
    Accuracy model: that of the forecasts; `measured` shows it.
    """
    first, second = (partial(_log_goal, source, goal) for goal in (goals.first, goals.second))
    return trade_off(
        Explorer(source),
        source.problem.settings,
        affordable_start(source),
        (first, second),
        partial(_measured, source, goals),
        points,
        method,
        watch,
    )


def _log_goal(
    source: ProblemSource, goal: str, points: Sequence[Floats], values: Sequence[Foresight]
) -> Floats:
    if goal == OBJECTIVE:
        return np.array([value.expected for value in values])
    return np.array(
        [
            math.nan if math.isnan(value.expected) else _log(source.design(point), goal)
            for point, value in zip(points, values, strict=True)
        ]
    )


def _log(problem: Problem, goal: str) -> float:
    costs = problem.costs()
    value = costs[goal].value if goal in costs else _expected(problem.expect(), goal)
    return math.log(value) if value > 0 else math.nan


def _expected(expected: Expectation, goal: str) -> float:
    if goal == OBJECTIVE:
        return expected.value
    return expected.parts[goal] if goal in expected.parts else expected.margins[goal].value


def _measured(
    source: ProblemSource, goals: ProblemGoals, coordinates: Floats, logs: Floats
) -> Point:
    design = source.design(coordinates)
    judged = design.judge(source.rows(design, source.problem.settings.most_trials, FRESH))
    costs = design.costs()
    first, second = (
        Interval(*[costs[goal].value] * 3) if goal in costs else _shown(judged, goal)
        for goal in (goals.first, goals.second)
    )
    expected = math.exp(logs[0]), math.exp(logs[1])
    values = source.values(coordinates)
    pair = first.value, second.value
    return Point(tuple(coordinates.tolist()), values, expected, pair, (first, second))


def _shown(judged: Judgement, goal: str) -> Interval:
    if goal == OBJECTIVE:
        return judged.value
    if goal in judged.parts:
        return judged.parts[goal]
    value, *ends = (margin.value for margin in judged.margins[goal])
    return Interval(value, min(ends), max(ends))
