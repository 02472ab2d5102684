"""Case -> the case with fixed values of all parameters that do not change the image of a star."""

from functools import lru_cache
from typing import Any

from startrack.attitude import Mounting, SolverSettings
from startrack.design import Case, unchecked
from startrack.identification import Identification

# Parameters that change neither the image of a star, nor its detection, nor its centroid.
NOT_SHOWN: dict[str, Any] = {
    "tracker.identification": Identification(),
    "tracker.attitude": SolverSettings(),
    "tracker.calibration": None,
    "tracker.mounting": None,
    "tracker.delay": None,
    "instrument.structure": None,
    "instrument.residual": None,
    "instrument.baffle": None,
    "instrument.tube": None,
    "instrument.mounting": Mounting(),
    "instrument.delay": 0.0,
    "variation": (),
    "lifetime": 0.0,
}


@lru_cache(maxsize=64)
def star_inputs(case: Case) -> Case:
    """The case with all parameters fixed that do not change images of single stars.

    Cases that differ only in identification, in calibration, or in the spacecraft share all results
    that are computed from it. Cached for the last 64 cases.
    """
    values = dict(NOT_SHOWN)
    if case.instrument.imaged:
        inside = {f"instrument.imaged.{name}": value for name, value in _of_instrument.items()}
        values |= inside
    shown: Case = unchecked(case, values)
    if case.design is None:
        return shown
    return shown.unit_of(star_inputs(case.design))


@lru_cache(maxsize=64)
def unmapped_inputs(case: Case) -> Case:
    """`star_inputs` without the age of the dark map, which changes no star's centroid.

    Units and their design then share the tracker's knowledge of its errors, at any age.
    """
    shown: Case = unchecked(star_inputs(case), {"tracker.detection.dark_map_age": None})
    return shown if case.design is None else shown.unit_of(unmapped_inputs(case.design))


_of_instrument = {
    name.removeprefix("instrument."): value
    for name, value in NOT_SHOWN.items()
    if name.startswith("instrument.")
}
