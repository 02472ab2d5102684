"""Better designs: search, Pareto front, sensitivity, tolerances.

search             Function over the unit cube -> the point of its least value (nlopt).
ledger             One SQLite file with the outcomes of all trials, so that no trial is repeated.
runner             TrialRunner: trials of any design; it keeps each outcome, so that no trial is
                   repeated.
budgets            Case -> analytic budgets of a design and of its units, kept for a search.
population         Judged condition -> the units that it is judged over: the unit as designed, or
                   drawn units.
forecast           Case -> its expected figures by the analytic budget, over its units.
evaluate           Point of a DesignSpace -> the score of its design.
gaussian_process   Points and values -> a Gaussian process through them, and its predictions.
explorer_settings  How an explorer chooses designs, and how their forecasts are emulated.
emulators          Forecasts of designs -> emulators of the objective and of each margin.
limit              A limit that trials decide -> the forecast margin that a design needs to meet
                   it.
correction         Trials of designs -> correction of the forecasts of other designs.
source             DesignSpace and campaign -> inputs of an explorer: forecasts, costs, conditions.
explorer           Source of designs -> forecasts where they are most informative.
search_log         A search -> a file with a line for each forecast and each design that was tried.
landscape          Emulators of a design space -> ranges and prices around its best design.
steps              The steps of the optimiser: start, forecasts, correction, refinement,
                   confirmation.
units              Fresh units of a design -> the error that a fraction of them does not exceed, and
                   yields.
optimise           Campaign, TrialRunner -> the best design that was found, judged by fresh trials.
improve            Problem -> a better problem: forecasts, trials that correct them, fresh trials
                   that decide.
problem_source     Problem, ledger -> inputs of the engines: forecasts, trials, costs.
problem_sweep      A problem, one or two of its keys -> objective and margins at each value; limits.
pareto             Designs, two goals -> the designs that no other design beats in both.
problem_front      Problem, two of its goals -> the designs that no other design beats in both.
sensitivity        Designs around a design -> dependence of the objective on each variable, alone
                   and with others.
what_matters       Designs around a design -> effect, share of the variance and range of each
                   variable.
figures            Design -> its errors, availability, margins and costs, by formula or by trials.
sweep              Values of one or two keys of a design file -> the figures of the design at each.
solve_for          A key, a limit -> the values of the key at which the design just meets the limit.
allocation         Case, units -> gain of each tolerance and each lever of a design.
ensemble           Log-probability -> samples and their convergence diagnostics (emcee).
priors             Laws of unknown values of a design -> variables of a sampling, with densities.
tolerance          Designs around a design -> tolerance of each variable, by emcee on a quadratic
                   surface.
tables             The results of studies as CSV, JSON lines and Markdown.
"""

from startrack.optimise.allocation import LeverChange, LeverGain, allocation, halved, levers
from startrack.optimise.budgets import budgets_of_units
from startrack.optimise.correction import fit_correction
from startrack.optimise.ensemble import Chains, Ensembles, draw, median_and_interval, thinned
from startrack.optimise.evaluate import (
    LOST,
    PENALTY,
    Evaluation,
    Foresight,
    evaluate,
    foresee,
    foresee_all,
    measured_margins,
    missed,
)
from startrack.optimise.explorer import Explorer
from startrack.optimise.figures import DesignFigures, Figure, middle
from startrack.optimise.forecast import (
    ExpectedDesign,
    Forecast,
    expect,
    expected_objective,
    forecasts,
    name_by_condition,
)
from startrack.optimise.improve import Improved, improve, verdicts
from startrack.optimise.landscape import Landscape
from startrack.optimise.ledger import Ledger
from startrack.optimise.optimise import Optimum, optimize
from startrack.optimise.pareto import FrontGoals, Point, front
from startrack.optimise.priors import LawPrior, priors_of
from startrack.optimise.problem_front import OBJECTIVE, ProblemGoals, problem_front
from startrack.optimise.problem_source import ProblemSource
from startrack.optimise.problem_sweep import ProblemSweep, solve_problem_for, sweep_problem
from startrack.optimise.runner import FRESH, VERIFYING, VERIFYING_UNIT, TrialRunner
from startrack.optimise.search import Algorithm, Search, SearchInput, minimise
from startrack.optimise.search_log import SearchLog
from startrack.optimise.sensitivity import Sensitivity, sensitivities, sobol_indices
from startrack.optimise.solve_for import LimitCrossing, Solution, solve_for
from startrack.optimise.source import DesignSource, TrackerSource, costs_of
from startrack.optimise.steps import (
    SearchStage,
    confirm_requirements,
    explore,
    refine,
    trials_of_tracker,
    unmet_costs,
)
from startrack.optimise.sweep import Sweep, SweptDesign, SweptKey, csv_of, sweep, swept_designs
from startrack.optimise.tables import (
    chain_text,
    chain_values,
    comparison,
    optimum_caveats,
    optimum_values,
    tolerance_table,
    tolerance_values,
    units_values,
    write_evaluations,
    write_samples,
)
from startrack.optimise.tolerance import Tolerance, designs_needed, fit_surface, region_of, sample
from startrack.optimise.units import (
    MeasuredUnits,
    compare_levels,
    fresh_units,
    level_interval_of_units,
    levels_of,
    measured_units,
    resampled_units,
    trial_noise,
    without_noise,
)
from startrack.optimise.what_matters import (
    Influence,
    WhatMatters,
    forecasts_needed,
    share,
    what_matters,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Algorithm",
    "Ensembles",
    "ExpectedDesign",
    "Forecast",
    "Foresight",
    "FrontGoals",
    "Improved",
    "LawPrior",
    "Ledger",
    "ProblemGoals",
    "ProblemSource",
    "Search",
    "SearchInput",
    "SearchStage",
    "Solution",
    "Sweep",
    "TrackerSource",
    "TrialRunner",
    "evaluate",
    "front",
    "improve",
    "levers",
    "minimise",
    "optimize",
    "priors_of",
    "problem_front",
    "sample",
    "sensitivities",
    "solve_for",
    "sweep",
    "what_matters",
]
