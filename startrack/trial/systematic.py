"""Case -> systematic variance of each star, which the tracker adds to that of the noise."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from startrack.attitude import UNKNOWN_FLOOR
from startrack.catalog import open_sky
from startrack.core import Floats, Stars
from startrack.design import Case
from startrack.trial.conditions import colour_correction, separable_stars
from startrack.trial.neighbours import blending_shift
from startrack.trial.star_errors import errors, lasting


@lru_cache(maxsize=8)
def systematic_variance(case: Case) -> Floats:
    """Variance per axis of a centroid that no noise explains, as a calibrated tracker knows it.

        variance = S-curve^2 + PRNU^2 + DSNU^2 + shift^2 / 2

    the first three from the tracker's centroids of noise-free stars of that magnitude (`errors`);
    the shift is that by the neighbours in its catalogue (`blending_shift`), along one line and so
    half of its square on either axis. `centroid_floor` replaces all of it where it is given.

    Returns  (n,) pixel^2, for the stars of the believed catalogue
    Accuracy  those of `errors` and `blending_shift`. model: for a detector that scans, the tracker
              assumes UNKNOWN_FLOOR.
    """
    stars, floor = open_sky(case.believed_catalog).stars, case.tracker.attitude.centroid_floor
    if floor is None and case.instrument.detector.scan:
        floor = UNKNOWN_FLOOR
    if floor is not None:
        return np.full(len(stars), floor**2)
    variance = lasting(errors(case), stars.magnitude_g + colour_correction(case, stars.colour)) ** 2
    catalog = case.believed_catalog
    name = separable_stars(catalog, case.instrument.camera).name
    variance[name] += (blending_shift(case, catalog) ** 2).sum(axis=1) / 2
    return variance


def systematic_variance_of(case: Case, stars: Stars) -> Floats:
    """`systematic_variance` (m,) of stars of the true sky; any value for those not believed in."""
    star, _ = open_sky(case.believed_catalog).stars.find(stars.identifier)
    return systematic_variance(case)[star]
