"""Case -> what the tracker reckons each star to err by, beside the noise that it measures."""

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
    """Variance per axis of a star's place that no noise explains, as a calibrated tracker knows it.

        own = S-curve^2 + PRNU^2 + DSNU^2 + pull^2 / 2

    each as the tracker's own centroid shows it on noise-free stars of that brightness (`errors`);
    the pull is that of the neighbours that its catalogue has (`pulls`), along one line and so half
    of it on either axis. `Attitude.centroid_floor` takes the place of all that where it is given.

    Returns  (n,) pixel^2, for the stars of the believed catalogue
    Accuracy  model: a detector that scans is not charted; its tracker reckons with UNKNOWN_FLOOR.
              Those of `errors` and `pulls`.
    """
    stars, floor = open_sky(case.believed_catalog).stars, case.tracker.attitude.centroid_floor
    if floor is None and case.instrument.detector.scan:
        floor = UNKNOWN_FLOOR
    if floor is not None:
        return np.full(len(stars), floor**2)
    own = lasting(errors(case), stars.magnitude_g + colour_correction(case, stars.colour)) ** 2
    catalog = case.believed_catalog
    name = separable_stars(catalog, case.instrument.camera).name
    own[name] += (blending_shift(case, catalog) ** 2).sum(axis=1) / 2
    return own


def systematic_variance_of(case: Case, stars: Stars) -> Floats:
    """The same (m,) for some stars of the true sky; of those that the tracker knows."""
    known = open_sky(case.believed_catalog).stars.identifier
    order = np.argsort(known)
    place = np.searchsorted(known, stars.identifier, sorter=order)
    return systematic_variance(case)[order[np.minimum(place, len(known) - 1)]]
