"""The estimate against the truth, in the terms of ECSS-E-ST-60-20C and 60-10C.

judge           Estimate and true attitude -> Outcome of one trial
summary         many outcomes -> rms errors and availability, each with its interval
levels          errors -> the size not exceeded at 68, 95.45 and 99.73 %, with its interval
indices         a sequence of errors -> absolute, mean, relative and drift errors

Without a single trial:

centroid_bound  flux, spot size and noise -> centroid error
attitude_bound  field of view, stars and centroid error -> attitude error
"""

from startrack.error.attitude_bound import attitude_bound
from startrack.error.centroid_bound import Star, centre_of_gravity_error, centroid_bound
from startrack.error.indices import Indices, indices, reproducibility
from startrack.error.judge import Outcome, judge
from startrack.error.levels import (
    LEVELS,
    Interpretation,
    fewest_trials,
    level,
    level_interval,
    levels,
)
from startrack.error.summary import Interval, Summary, rms_interval, share_interval, summarise

__all__ = [
    "LEVELS",
    "Indices",
    "Interpretation",
    "Interval",
    "Outcome",
    "Star",
    "Summary",
    "attitude_bound",
    "centre_of_gravity_error",
    "centroid_bound",
    "fewest_trials",
    "indices",
    "judge",
    "level",
    "level_interval",
    "levels",
    "reproducibility",
    "rms_interval",
    "share_interval",
    "summarise",
]
