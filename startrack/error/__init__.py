"""The estimate against the truth, in the terms of ECSS-E-ST-60-20C.

judge    Estimate and true attitude -> Outcome of one trial
summary  many outcomes -> rms errors and availability, each with its interval
"""

from startrack.error.judge import Outcome, judge
from startrack.error.summary import Interval, Summary, rms_interval, share_interval, summarise

__all__ = [
    "Interval",
    "Outcome",
    "Summary",
    "judge",
    "rms_interval",
    "share_interval",
    "summarise",
]
