"""Error budgets: the attitude error of a design split by cause, by analysis and by trials.

budget     Causes of error and the case without each; Budget: a line for each, and their sum.
fields     Sky and camera -> the stars of many fields, and attitude errors from star errors.
fixed      Case and fields of stars -> errors that are constant from frame to frame.
hot_pixels  Case -> effect of hot pixels on the stars that its tracker detects, and on its search.
tracked    Fields of stars -> which fields the tracker identifies, and the errors that it states.
analytic   Case -> its Budget in milliseconds, without a trial.
blind      Case without a solved field -> the reason: stars, light, dark current or tracker.
left_out   Case and its fields of stars -> effects that the analytic budget leaves out; check of the
           budget by trials.
exclusion  Case with a baffle -> error over the angle to Sun, Moon and Earth; exclusion angles.
measured   Case -> Budget by trials: each cause is switched off, on the same sky and noise; the
           error indices of the standard by sequences, over members and times.
units      Case -> error budgets of many units at an age: classes of error and levels.
single_stars  Case -> centroid errors of single stars: by formula, in boxes, in trials.
curves     Case -> attitude error over the sky and over slew rate, centroid errors of its stars.
"""

from startrack.budget.analytic import analytic, refuse_scans
from startrack.budget.budget import (
    Budget,
    BudgetLine,
    ErrorLaw,
    SkySample,
    Spread,
    answer,
    errors_text,
)
from startrack.budget.curves import (
    LONGEST,
    SMEARS,
    BudgetCurve,
    ErrorCurves,
    RateSurvey,
    Slew,
    analytic_curve,
    budget_and_sky,
    curve_steps,
    error_curves,
    slew_rates,
    slews,
    survey,
)
from startrack.budget.exclusion import Exclusion, exclusions, stray_light_levels
from startrack.budget.fields import attitudes, boresights
from startrack.budget.left_out import (
    ADVICE,
    TrialCheck,
    advice,
    caveats,
    check,
    differences,
    noise_only,
    of_the_case,
    refusal,
    unseen,
)
from startrack.budget.measured import INDICES, indices_of, measured
from startrack.budget.single_stars import Residuals, StarErrors, single_stars, star_errors
from startrack.budget.units import PUBLISHED, UnitBudgets, joined, unit_budgets
from startrack.trial import Term

# Public; the other imports serve other rooms.
__all__ = [
    "Budget",
    "analytic",
    "check",
    "exclusions",
    "measured",
    "single_stars",
    "survey",
    "unit_budgets",
]
