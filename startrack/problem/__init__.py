"""Problems for search, sampling and test: parameters, costs, forecast, trials, judgement.

values   Margin, Expectation, Judgement, TrialView, Words, Bounds: results of a problem.
problem  Problem: the interface for the engines; a star tracker, an Earth camera, or a user's own.
compare  Rows of the same trials of two problems -> differences of their values.
run      Trials of a problem by their numbers, the same for any number of workers.
table    Judgement, expectation -> lines with the values by trials and by formula.
"""

from startrack.problem.compare import ProblemDifference, compare_problems, require_one_objective
from startrack.problem.problem import Problem, SearchSettings, Settings
from startrack.problem.run import run_problem
from startrack.problem.table import beside_forecast, ratios_answer, with_interval
from startrack.problem.values import (
    Bounds,
    Expectation,
    Judgement,
    Margin,
    TrialImage,
    TrialView,
    Words,
)

__all__ = [
    "Bounds",
    "Expectation",
    "Judgement",
    "Margin",
    "Problem",
    "ProblemDifference",
    "SearchSettings",
    "Settings",
    "TrialImage",
    "TrialView",
    "Words",
    "beside_forecast",
    "compare_problems",
    "ratios_answer",
    "run_problem",
    "with_interval",
]
