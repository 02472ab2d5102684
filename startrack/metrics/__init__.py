"""The estimate against the truth: outcomes, statistics, confidence levels, bounds.

bounds   Cramer-Rao bounds of centroid and attitude, and the error of the centre of gravity.
judge    Outcome of one trial from its estimate and the true attitude; which attitudes are correct.
ratios   The ratio of two rms errors or levels, with its interval.
summary  Rms errors and availability of many outcomes, each with its interval.
results  Results as rows and tables of records, written as JSON, text or Markdown.
levels   Size of the error that is not exceeded at a stated confidence level, and the error indices
         of ECSS-E-ST-60-10C from a sequence of errors.
"""

from startrack.metrics.bounds import Star, attitude_bound, centroid_bound
from startrack.metrics.judge import (
    FALSE_ANGLE,
    JUDGED,
    STATED,
    STATED_ALONE,
    ErrorLimits,
    Outcome,
    correct,
    judge,
    judge_all,
)
from startrack.metrics.levels import (
    LEVELS,
    Interpretation,
    indices,
    level,
    level_bounds,
    level_interval,
    level_ranks,
    quantile_of_few,
    reproducibility,
    resampled_interval,
)
from startrack.metrics.ratios import ratio_of_levels, ratio_of_rms, trials_for_level
from startrack.metrics.results import (
    ARCSEC,
    PERCENT,
    PURE,
    SECOND,
    Column,
    DisplayUnit,
    Row,
    Table,
    bounds_json,
    bracketed,
    end_text,
    four_digits,
    markdown,
    summary_rows,
    to_cells,
    to_json,
    to_lines,
)
from startrack.metrics.summary import (
    Interval,
    Summary,
    beyond_ten_sigma,
    bounds_of_mean,
    effective_part,
    fraction_interval,
    fraction_of_trials,
    independent,
    interval_table,
    interval_text,
    mean_bounds,
    rms_interval,
    summarise,
    units_of,
)

# Public; the other imports serve other rooms.
__all__ = [
    "ErrorLimits",
    "Star",
    "attitude_bound",
    "centroid_bound",
    "fraction_interval",
    "judge",
    "reproducibility",
    "rms_interval",
    "summarise",
]
