"""Units of a design: their draws, their calibrations, and fast trials over many of them.

calibrate  Camera of a unit -> camera model and alignment by its calibration, which is run or drawn
           from its covariance.
unit       Case, seed, moment -> the case of one unit, with its tracker's calibration.
nodes      Case -> plans at nodes of the numbers that vary, and the plan of any unit between them.
yields     Units -> outcomes of trials over many units; error of each, yield, causes of a bad unit.
"""

from startrack.population.calibrate import calibrated, drawn, left_over
from startrack.population.nodes import of_places
from startrack.population.unit import middle_of, placed, unit_of
from startrack.population.yields import (
    AS_DESIGNED,
    UNITS,
    AsDesigned,
    PerUnit,
    Units,
    explain,
    per_unit,
    stored_units,
    unit_errors,
    unit_trials,
    with_units,
)

# Public; the other imports serve other rooms.
__all__ = ["AsDesigned", "Units"]
