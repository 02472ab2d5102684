"""Rows of the same trials of two problems -> differences of their values."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Refused, Rows, Streams
from startrack.metrics import Interval
from startrack.problem.problem import Problem
from startrack.problem.values import Judgement

RESAMPLES = 400  # chosen by hand: ends of an interval scatter by a tenth of its width


class ProblemDifference(NamedTuple):
    """One value of two problems.

    name           in words
    unit           as a text
    first, second  of each problem
    ratio          second over first, with its 95 % interval
    """

    name: str
    unit: str
    first: float
    second: float
    ratio: Interval


def compare_problems(
    problems: tuple[Problem, Problem], rows: tuple[Rows, Rows], seed: int = 1
) -> list[ProblemDifference]:
    """Objective and parts of two problems, on the same trials, and their ratios.

    The intervals are those of a paired bootstrap: resamples of trials, the same of both problems,
    and the quantiles of ln(ratio) about its value. Source: Efron and Tibshirani (1993), An
    Introduction to the Bootstrap, 13.3.

    rows    (n,) of each, trials of the same numbers in the same order
    seed    of the resamples
    Raises  Refused if the problems have other objectives, or other numbers of trials.
    Accuracy  statistical: of 50 trials and more; a quantile that the few largest rows decide needs
              some ten of them beyond it.
    """
    require_one_objective(problems)
    words = [problem.text() for problem in problems]
    count = len(rows[0])
    if len(rows[1]) != count:
        raise Refused(f"both must have the same trials, got {count} and {len(rows[1])}")
    names = [name for name in words[0].parts if name in words[1].parts]
    value = np.array(
        [_values(problem.judge(own), names) for problem, own in zip(problems, rows, strict=True)]
    )
    random = Streams(seed, 0)("resamples of two problems")
    logs = np.empty((RESAMPLES, 1 + len(names)))
    for row in logs:
        some = random.integers(0, count, count)
        first, second = (
            _values(problem.judge(own[some]), names)
            for problem, own in zip(problems, rows, strict=True)
        )
        row[:] = _log_ratio(first, second)
    titles = [(words[0].value, words[0].unit), *(words[0].parts[name] for name in names)]
    return [
        ProblemDifference(*title, float(pair[0]), float(pair[1]), _interval(pair, log))
        for title, pair, log in zip(titles, value.T, logs.T, strict=True)
    ]


def require_one_objective(problems: tuple[Problem, Problem]) -> None:
    """Refuse to compare problems with other objectives, before any trial."""
    first, second = (problem.text() for problem in problems)
    if first.value != second.value or first.unit != second.unit:
        raise Refused(f"both must have one objective, got {first.value} and {second.value}")


def _values(judged: Judgement, names: list[str]) -> Floats:
    return np.array([judged.value.value, *(judged.parts[name].value for name in names)])


def _log_ratio(first: Floats, second: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(second) - np.log(first)


def _interval(pair: Floats, logs: Floats) -> Interval:
    ratio = math.exp(float(_log_ratio(pair[0], pair[1]))) if (pair > 0).all() else math.nan
    if not np.isfinite(logs).all() or not math.isfinite(ratio):
        return Interval(ratio, 0.0, math.inf)
    low, high = np.quantile(logs, (0.025, 0.975))
    return Interval(ratio, math.exp(low), math.exp(high))
