"""The error budget of a case in the terms of ECSS-E-ST-60-20C.

causes    what makes errors, under which term, and the case without it
budget    Budget: a line for each cause, their sum, the whole
analytic  Case -> Budget, in milliseconds and without a trial
chart     what it asks of the tracker: noise-free stars of all places and magnitudes, measured
fields    what it asks of the sky: the stars of many fields, and errors of stars into attitudes
"""

from startrack.budget.analytic import analytic
from startrack.budget.budget import Budget, Law, Line, Sample
from startrack.budget.causes import Cause, Term, causes

__all__ = ["Budget", "Cause", "Law", "Line", "Sample", "Term", "analytic", "causes"]
