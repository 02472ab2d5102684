"""Units of a design: their draws, their calibrations, and fast trials over many of them.

calibrate  Camera of a unit -> the camera model and alignment that its calibration finds, by running
           the estimator or by drawing from its covariance.
unit       Case, seed, moment -> the case of one unit, with what its tracker was calibrated to.
nodes      Case -> plans at nodes of the numbers that vary, and the plan of any unit between them.
yields     Outcomes of trials of units -> error of each unit, yield, and what made one bad.
trials     Units -> outcomes of trials of many units, each with its unit and environment.
"""

from startrack.population.nodes import of_places
from startrack.population.trials import UNITS, Units, unit_trials
from startrack.population.unit import middle_of, placed, unit_of
from startrack.population.yields import PerUnit, explain, per_unit, unit_errors

# Public; the other imports serve other rooms.
__all__ = ["Units"]
