"""Better designs: search, Pareto front, sensitivity, tolerances.

search       A function over the unit cube enters; the place where it is least leaves (nlopt).
ledger       One SQLite file that remembers what was tried, so that no trial is done twice.
runner       Bench: where designs are tried; it remembers each trial, so that none is done twice.
margins      A Case enters; how far it meets the requirements that need no trials leaves.
evaluate     A place in a box enters; how good its design is leaves.
steps        The steps of the optimiser: prospect, reach, correction, refine, race, assure.
optimise     A campaign and a bench enter; the best design that was found, and how good it is,
             leaves.
pareto       A box and two objectives enter; the designs that none beats in both leave.
sensitivity  A box enters; how much the error depends on each variable, alone and with others,
             leaves.
ensemble     A log-probability enters; samples leave, with what tells whether to believe them
             (emcee).
tolerance    A design enters; how far each parameter may vary leaves, by emcee on a quadratic
             surface.
tables       The results of studies as CSV, JSON lines and Markdown.
"""

from startrack.optimise.ensemble import Chains, Ensembles, draw, median_and_ends, thinned
from startrack.optimise.evaluate import Evaluation, evaluate, expect, expected_error, foresee
from startrack.optimise.ledger import Ledger
from startrack.optimise.optimise import Optimum, optimize
from startrack.optimise.pareto import UNITS, Goals, Point, front
from startrack.optimise.runner import TrialRunner
from startrack.optimise.search import Algorithm, Found, Search, least
from startrack.optimise.sensitivity import Sensitivity, sensitivities
from startrack.optimise.steps import prospect
from startrack.optimise.tables import (
    chain_text,
    chain_values,
    comparison,
    tolerance_table,
    tolerance_values,
    write_evaluations,
    write_samples,
)
from startrack.optimise.tolerance import Tolerance, designs_needed, sample

# Public; the other imports serve other rooms.
__all__ = [
    "Algorithm",
    "Chains",
    "Ensembles",
    "Evaluation",
    "Found",
    "Goals",
    "Ledger",
    "Optimum",
    "Point",
    "Search",
    "Sensitivity",
    "Tolerance",
    "TrialRunner",
    "comparison",
    "evaluate",
    "front",
    "least",
    "optimize",
    "sample",
    "sensitivities",
]
