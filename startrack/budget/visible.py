"""Case and fields -> the stars that lie on the detector, and those that the tracker knows."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from startrack.budget.fields import Fields
from startrack.case import Case
from startrack.catalog import Selection, open_sky
from startrack.values import Floats, Ints


def visible(case: Case, view: Fields, faintest: float, fainter: Floats) -> tuple[Ints, Floats]:
    """Which stars of the fields lie where a window fits, and their magnitudes."""
    camera, detection = case.instrument.camera, case.tracker.detection
    stars = view.sky.stars
    reach = np.tan(min(1.1 * camera.half_diagonal, 1.5))
    near = (np.abs(view.x) < reach) & (np.abs(view.y) < reach)
    near &= stars.magnitude_g[view.star] < faintest + 1  # red stars are brighter than their G
    near = np.flatnonzero(near)
    pixel = camera.project(np.column_stack([view.x[near], view.y[near], np.ones(len(near))]))
    near = near[camera.holds(pixel, -(detection.window // 2 + detection.edge))]
    star = view.star[near]
    magnitude = stars.magnitude_g[star] + fainter[star]
    believed = believed_place(case.catalog, case.believed_catalog)[view.name[star]]
    seen = (magnitude < faintest) & (believed >= 0)
    return near[seen], magnitude[seen]


@lru_cache(maxsize=16)
def believed_place(true: Selection, believed: Selection) -> Ints:
    """For each star of the true sky its index in the believed one, -1 where it is not there."""
    here, there = open_sky(true).stars.identifier, open_sky(believed).stars.identifier
    order = np.argsort(there, kind="stable")
    place = np.minimum(np.searchsorted(there, here, sorter=order), len(there) - 1)
    found = order[place]
    return np.where(there[found] == here, found, -1)
