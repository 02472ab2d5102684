"""What can be searched, sampled and tested: parameters, costs, a forecast, trials, a judgement.

values   Margin, Expectation, Judgement, Words, Bounds: what a problem gives.
problem  Problem: what the engines ask of it; a star tracker, an Earth camera, or a user's own.
compare  Rows of the same trials of two problems -> by how much their values differ.
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
