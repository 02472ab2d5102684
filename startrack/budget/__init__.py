"""The error budget of a case in the terms of ECSS-E-ST-60-20C.

causes      what makes errors, under which term, and the case without it
budget      Budget: a line for each cause, their sum, the whole
analytic    Case -> Budget, in milliseconds and without a trial
measured    the same by trials, with causes switched on the same sky and noise

What these are made of:

chart       noise-free stars of all places and magnitudes, measured by the tracker's centroid
neighbours  how far the light of other stars moves a star
fields      the stars of many fields of the sky, and errors of stars into errors of attitudes
quiet       frames without noise, and noise without frames
"""

from startrack.budget.analytic import analytic
from startrack.budget.budget import Budget, Law, Line, Sample
from startrack.budget.causes import Cause, Term, causes
from startrack.budget.measured import measured

__all__ = ["Budget", "Cause", "Law", "Line", "Sample", "Term", "analytic", "causes", "measured"]
