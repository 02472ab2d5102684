"""Whether a design meets its requirements, by formulas, by analysis and by trials.

margins   Case -> its margins to the requirements that need no trials.
accuracy  Budget, or outcomes -> the statistic of the error that a requirement is about.
cases     Design and campaign -> every case that is judged: conditions and keep-out angles.
decide    Outcomes, a requirement -> bounds at a look, and whether they decide it.
blinded   Outcomes of trials -> those that count, without those blinded by Sun, Moon or Earth.
verify    Design, campaign -> a verdict on each requirement, by analysis and by trials.
units     Design, campaign, units -> a verdict on each requirement by its yield.
table     Verification -> the table of its verdicts as texts, and the sentences below it.
"""

from startrack.verification.accuracy import (
    REGIONS,
    expected_error,
    expected_in_all,
    expected_margins,
    expected_over,
    margin,
    measured_over,
    units_expected,
    yield_of,
)
from startrack.verification.blinded import boresights, counted
from startrack.verification.cases import cases
from startrack.verification.decide import Answer, Claim, Looks, YieldClaim, claims_of, mean_bounds
from startrack.verification.margins import (
    cost_margins,
    limiting_magnitude,
    margins,
    needed_magnitude,
)
from startrack.verification.table import HEAD as VERDICT_HEAD
from startrack.verification.table import notes as verdict_notes
from startrack.verification.table import rows as verdict_rows
from startrack.verification.table import text as verdict_text
from startrack.verification.table import values as verdict_values
from startrack.verification.units import (
    USUAL,
    UnitVerification,
    unit_text,
    unit_values,
    verify_units,
)
from startrack.verification.verify import Verdict, Verification, verify

# Public; the other imports serve other rooms.
__all__ = ["Answer", "Claim", "Looks", "Verdict", "Verification", "verify"]
