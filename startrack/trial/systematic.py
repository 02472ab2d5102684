"""Case -> what the tracker reckons each star to err by, beside the noise that it measures."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from startrack.attitude import UNKNOWN_FLOOR
from startrack.catalog import open_sky
from startrack.core import Floats, Stars
from startrack.design import Case
from startrack.trial.conditions import dimming, separate
from startrack.trial.neighbours import pulls
from startrack.trial.star_errors import errors, lasting


@lru_cache(maxsize=8)
def trust(case: Case) -> Floats:
    """Variance per axis of a star's place that no noise explains, as a calibrated tracker knows it.

        own = S-curve^2 + PRNU^2 + DSNU^2 + pull^2 / 2

    each as the tracker's own centroid shows it on noise-free stars of that brightness (`errors`);
    the pull is that of the neighbours that its catalogue has (`pulls`), along one line and so half
    of it on either axis. `Attitude.centroid_floor` takes the place of all that where it is given.

    Returns  (n,) pixel^2, for the stars of the believed catalogue
    Errors   model: a detector that scans is not charted; its tracker reckons with UNKNOWN_FLOOR.
             Those of `errors` and `pulls`.
    """
    stars, floor = open_sky(case.believed_catalog).stars, case.tracker.attitude.centroid_floor
    if floor is None and case.instrument.detector.scan:
        floor = UNKNOWN_FLOOR
    if floor is not None:
        return np.full(len(stars), floor**2)
    own = lasting(errors(case), stars.magnitude_g + dimming(case, stars.colour)) ** 2
    catalog = case.believed_catalog
    name = separate(catalog, case.instrument.camera).name
    own[name] += (pulls(case, catalog) ** 2).sum(axis=1) / 2
    return own


def trust_in(case: Case, stars: Stars) -> Floats:
    """The same (m,) for some stars of the true sky; of those that the tracker knows."""
    known = open_sky(case.believed_catalog).stars.identifier
    order = np.argsort(known)
    place = np.searchsorted(known, stars.identifier, sorter=order)
    return trust(case)[order[np.minimum(place, len(known) - 1)]]
