"""Better designs: search, Pareto front, sensitivity, tolerances.

search       Function over the unit cube -> the point of its least value (nlopt).
ledger       One SQLite file with the outcomes of all trials, so that no trial is repeated.
runner       TrialRunner: trials of any design; it keeps each outcome, so that no trial is repeated.
evaluate     Point of a DesignSpace -> the score of its design.
steps        The steps of the optimiser: prospect, reach, correction, refine, race, assure.
optimise     Campaign, TrialRunner -> the best design that was found, and how good it is.
pareto       DesignSpace, two objectives -> the designs that no other design beats in both.
sensitivity  DesignSpace -> how much the error depends on each variable, alone and together with
             others.
ensemble     Log-probability -> samples and their convergence diagnostics (emcee).
tolerance    Design -> how far each parameter may vary, by emcee on a quadratic surface.
tables       The results of studies as CSV, JSON lines and Markdown.
"""

from startrack.optimise.ensemble import Chains, Ensembles, draw, median_and_ends, thinned
from startrack.optimise.evaluate import Evaluation, evaluate, expect, expected_objective, foresee
from startrack.optimise.ledger import Ledger
from startrack.optimise.optimise import Optimum, optimize
from startrack.optimise.pareto import UNITS, Goals, Point, front
from startrack.optimise.runner import VERIFYING, TrialRunner
from startrack.optimise.search import Algorithm, Found, Search, least
from startrack.optimise.sensitivity import Sensitivity, sensitivities
from startrack.optimise.steps import prospect
from startrack.optimise.tables import (
    chain_text,
    chain_values,
    comparison,
    optimum_caveats,
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
