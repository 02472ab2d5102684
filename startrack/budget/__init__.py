"""The error budget of a case in the terms of ECSS-E-ST-60-20C.

causes      what makes errors, under which term, and the case without it
budget      Budget: a line for each cause, their sum, the whole
analytic    Case -> Budget, in milliseconds and without a trial
measured    the same by trials, with causes switched on the same sky and noise
survey      stars, availability and error over the sky
indices     sequences -> absolute, mean and relative errors and drift, with their levels
exclusion   what Sun, Moon and Earth cost over their angle through a baffle
residuals   what single stars err by in trials

What these are made of:

response    errors of single stars as tables over their magnitude
fixed       what causes that do not change move, neighbouring stars among them
visible     the stars that lie on the detector
fields      the stars of many fields of the sky, and errors of stars into errors of attitudes
"""

from startrack.budget.analytic import analytic
from startrack.budget.budget import Budget, Law, Line, Sample, Spread
from startrack.budget.causes import Cause, Term, causes
from startrack.budget.exclusion import Exclusion, exclusions
from startrack.budget.indices import INDICES, indices_of
from startrack.budget.measured import measured
from startrack.budget.survey import Survey, circles, survey

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
