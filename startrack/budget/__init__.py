"""What the error is made of, cause by cause, by analysis and by trials.

causes     Causes of error, under the terms of the standard, and the case without each of them.
budget     Budget: a line for each cause of error, their sum, and the whole; about and across.
fields     Sky and camera -> the stars of many fields, and what errors of their places do to
           attitudes.
fixed      A Case and fields of stars enter; errors that do not change from frame to frame leave.
analytic   A Case enters; its Budget leaves in milliseconds, without a trial.
survey     Case -> how many stars it sees, how often it solves and how far it errs, over the sky.
exclusion  Case with a baffle -> what Sun, Moon and Earth cost over their angle; exclusion angles.
indices    Simulated sequences -> the error indices of the standard, over members and times.
measured   Case -> Budget by trials: causes switched off one by one, on the same sky and the same
           noise.
residuals  Case -> what single stars err by in trials: over their place in the field and their
           magnitude.
"""

from startrack.budget.analytic import analytic
from startrack.budget.budget import Budget, Law, Line, Sample, Spread
from startrack.budget.causes import Cause, Term, causes
from startrack.budget.exclusion import Exclusion, exclusions
from startrack.budget.fields import attitudes
from startrack.budget.indices import INDICES, indices_of
from startrack.budget.measured import measured
from startrack.budget.residuals import residuals
from startrack.budget.survey import Survey, circles, survey

# Public; the other imports serve other rooms.
__all__ = [
    "INDICES",
    "Budget",
    "Cause",
    "Exclusion",
    "Law",
    "Line",
    "Sample",
    "Spread",
    "Survey",
    "Term",
    "analytic",
    "causes",
    "circles",
    "exclusions",
    "indices_of",
    "measured",
    "survey",
]
