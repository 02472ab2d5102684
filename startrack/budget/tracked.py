"""Fields of stars -> which fields the tracker identifies, and the errors that it states.

If the tracker assumes a wrong camera or catalogue, stars lie far from their predicted places. Which
stars it matches, and whether it accepts the match, then depends on all stars together.
Probabilities of single stars cannot describe this. Therefore the tracker's own identification and
solver decide, on drawn spots.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.special import ndtr, ndtri

from startrack import trial
from startrack.budget.fields import Fields, believed_index
from startrack.core import Flags, Floats, Ints, Refused, Streams
from startrack.design import Case
from startrack.metrics import STATED

HOPELESS = 32  # number of fields without an attitude after which the search for one ends
GOLDEN = (5**0.5 - 1) / 2  # multiples of it, modulo 1, are evenly spread
NEAR = 2.0  # pixel, from a star to its spot
SEED = 0  # seed of the drawn spots, the same in all designs
LEVELS = ndtri((np.arange(32) + 0.5) / 32)  # equally probable values of a normal distribution
LOST = (
    "the camera and the catalogue that the tracker assumes must place stars where it finds them, "
    "but it identifies none of {} drawn fields; calibrate it (tracker.camera, "
    "tracker.calibration), or widen tracker.identification.focal_tolerance and match_radius"
)


class Tracked(NamedTuple):
    """Result of the tracker in m fields with n stars in total.

    solved   (m,) whether it has a correct attitude
    covered  (m, 2) whether the errors across and about lie within the stated ones
    dropped  (n,) whether the star has a spot that the attitude does not use
    """

    solved: Flags
    covered: Flags
    dropped: Flags


def tracked(case: Case, view: Fields, inside: Ints) -> Tracked:
    """Draw the spots of each field, then identify and solve them as the tracker does.

    inside   (n,) indices into the stars of the fields
    Raises   Refused if drawn spots do not support the design, or no field is identified.
    """
    trial.refuse(case)
    count = len(view.attitude)
    solved, covered = np.zeros(count, bool), np.zeros((count, 2), bool)
    dropped = np.zeros(len(inside), bool)
    believed = believed_index(case.catalog, case.believed_catalog)[view.name[view.star[inside]]]
    pixel = case.instrument.camera.project(
        np.column_stack([view.x[inside], view.y[inside], np.ones(len(inside))])
    )
    first = np.searchsorted(view.field[inside], np.arange(count + 1))
    order = np.argsort(GOLDEN * np.arange(count) % 1)  # over all of the sky
    for n, f in enumerate(order.tolist()):
        if n == min(HOPELESS, count - 1) and not solved.any():
            raise Refused(LOST.format(n))
        attitude = view.attitude[f]
        spots, matches, estimate, outcome = trial.drawn(case, attitude, Streams(SEED, f))
        solved[f] = outcome.solved and not outcome.false
        if not solved[f]:
            continue
        x, y = outcome.error_x / outcome.sigma_x, outcome.error_y / outcome.sigma_y
        covered[f] = np.hypot(x, y) <= STATED, abs(outcome.error_z) <= STATED * outcome.sigma_z
        part = slice(first[f], first[f + 1])
        used = matches.star if estimate.used is None else matches.star[estimate.used]
        distance, _ = KDTree(np.column_stack([spots.x, spots.y])).query(pixel[part])
        dropped[part] = (distance < NEAR) & ~np.isin(believed[part], used)
    return Tracked(solved, covered, dropped)


def within_stated(mean: Floats, sigma: Floats, stated: Floats) -> Floats:
    """Probability (m, 2) that errors across and about lie within STATED stated standard deviations.

        hypot(x / stated_x, y / stated_y) <= STATED,   |z| <= STATED stated_z

    mean, sigma  (m, 3) radian, of normal errors about the camera's axes
    stated       (m, 3) radian
    Accuracy  numerical: 0.03 for errors across, if the probability is near 0.5.
    """
    sigma, stated = np.maximum(sigma, 1e-30), np.maximum(stated, 1e-30)
    low, high = ((sign * STATED * stated - mean) / sigma for sign in (-1, 1))
    x = mean[:, :1] + sigma[:, :1] * LEVELS
    # Half of the chord of the circle at each x.
    square = STATED**2 - (x / stated[:, :1]) ** 2
    y = np.sqrt(np.maximum(square, 0.0)) * stated[:, 1:2]
    inside = ndtr((y - mean[:, 1:2]) / sigma[:, 1:2]) - ndtr((-y - mean[:, 1:2]) / sigma[:, 1:2])
    about = ndtr(high[:, 2]) - ndtr(low[:, 2])
    return np.stack([np.where(square > 0, inside, 0.0).mean(axis=1), about], axis=-1)
