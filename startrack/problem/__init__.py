"""What can be searched, sampled and tested: parameters, costs, a forecast, trials, a judgement.

values   Margin, Expectation, Judgement, Words, Bounds: what a problem gives.
problem  Problem: what the engines ask of it; a star tracker, an Earth camera, or a user's own.
run      Trials of a problem by their numbers, the same for any number of workers.
"""

from startrack.problem.problem import Problem, SearchSettings, Settings
from startrack.problem.run import run_problem
from startrack.problem.values import Bounds, Expectation, Judgement, Margin, Words

__all__ = [
    "Bounds",
    "Expectation",
    "Judgement",
    "Margin",
    "Problem",
    "SearchSettings",
    "Settings",
    "Words",
    "run_problem",
]
