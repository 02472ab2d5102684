"""Problems for search, sampling and test: parameters, costs, forecast, trials, judgement.

values   Margin, Expectation, Judgement, Words, Bounds: results of a problem.
problem  Problem: the interface for the engines; a star tracker, an Earth camera, or a user's own.
compare  Rows of the same trials of two problems -> differences of their values.
run      Trials of a problem by their numbers, the same for any number of workers.
"""

from startrack.problem.compare import ProblemDifference, compare_problems
from startrack.problem.problem import Problem, SearchSettings, Settings
from startrack.problem.run import run_problem
from startrack.problem.values import Bounds, Expectation, Judgement, Margin, Words

__all__ = [
    "Bounds",
    "Expectation",
    "Judgement",
    "Margin",
    "Problem",
    "ProblemDifference",
    "SearchSettings",
    "Settings",
    "Words",
    "compare_problems",
    "run_problem",
]
