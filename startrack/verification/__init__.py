"""Verification: whether a design meets its requirements, by formulas, by analysis and by trials.

accuracy  Budget, outcomes of trials, case -> the statistic that a requirement limits, and its
          margin.
cases     Design and campaign -> all cases to judge (conditions, keep-out angles), and the trials
          that count.
decide    Outcomes and a requirement -> bounds of its statistic, and whether they decide it.
verify    Design, campaign -> a verdict on each requirement, by analysis and by trials, and the
          table of them.
problem   Problem -> a verdict on each of its limits, by formula and by trials.
units     Design, campaign, units -> a verdict on each requirement by its yield.
windows_of_flight  Star images downlinked by a tracker: files of windows, and windows cut from whole
                   frames.
figures   Windows of flight -> measured figures: centroids, light, noise, photon transfer, image.
frame_figures  Figures measured from frames, and the same figures predicted by the design.
prediction  Case and windows of flight -> images by the design for the same stars and paths.
flown     Windows of flight and the design -> each figure, predicted and measured.
"""

from startrack.verification.accuracy import (
    cost_margins,
    expected_error,
    expected_margins,
    expected_of,
    expected_over,
    limited,
    margin,
    margins,
    measured_over,
    needed_magnitude,
    units_expected,
    yield_of,
)
from startrack.verification.cases import boresights, cases, counted
from startrack.verification.decide import Answer, Claim, Looks, YieldClaim, claims_of, tails
from startrack.verification.figures import centroids, correlation, gain_in_flight, image_of_other
from startrack.verification.flown import FlightComparison, compare_flown
from startrack.verification.frame_figures import (
    expected_in_frames,
    expected_of_star,
    told_by_frames,
)
from startrack.verification.prediction import simulate
from startrack.verification.problem import problem_verdict_table, verify_problem
from startrack.verification.units import (
    USUAL,
    trials_of_a_unit,
    unit_text,
    unit_values,
    verify_units,
)
from startrack.verification.verify import (
    Verdict,
    bounds_of_errors,
    number_of_claims,
    verdict_notes,
    verdict_table,
    verdict_text,
    verdict_values,
    verification_values,
    verify,
    with_bounds,
)
from startrack.verification.windows_of_flight import (
    Windows,
    read_windows,
    windows_of_frames,
    with_magnitudes,
)

# Public; the other imports serve other rooms.
__all__ = ["Looks", "Windows", "compare_flown", "gain_in_flight", "read_windows", "simulate"]
