"""Spots and a predicted attitude enter; Matches leave."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.identification.follow import FEWEST, follow
from startrack.identification.identify import identify, refined
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification
from startrack.identification.seen import first, see, usable
from startrack.values import Floats, Matches, Spots, Stars

EDGE = 3.0  # sigma of the prediction


def track(
    spots: Spots,
    camera: Camera,
    stars: Stars,
    index: PatternIndex,
    predicted: Rotation,
    covariance: Floats,
    settings: Identification,
) -> Matches:
    """Which spot is which star, if the attitude is about known. Two stars may be enough.

    The same evidence as without a prediction decides, only that the attitudes are not all
    equally likely beforehand, but as the prediction says; `settings.max_false_track` bounds how
    often spots that are no stars at all are matched. Where it is not enough, the search
    begins anew with `identify`.

    spots       brightest first; those at no finite place are left out
    camera      as the last frame refined it: its focal length is believed
    predicted   icrs_to_camera, carried to the middle of this exposure
    covariance  (3, 3) radian^2, of the small rotation about the camera's axes
    Returns     as `identify`
    Errors      ValueError where the covariance is not positive definite. model: windows are
                linear in the error of the prediction, which holds up to some degrees.
    """
    covariance = np.array(covariance, float)
    if covariance.shape != (3, 3) or not (np.linalg.eigvalsh(covariance) > 0).all():
        raise ValueError(f"covariance must be (3, 3) and positive definite, got {covariance}")
    believed = replace(settings, focal_tolerance=0.0)
    finite = usable(spots)
    if len(finite) >= FEWEST:
        seen = first(see(spots, finite, camera, believed), settings.verify_spots)
        # A star that the prediction puts outside the image may be inside.
        margin = EDGE * math.sqrt(np.linalg.eigvalsh(covariance)[-1])
        wider = seen._replace(
            low=seen.low - margin, high=seen.high + margin, corner=seen.corner + 2 * margin
        )
        rotation, matches, log_p = follow(wider, index.bright, predicted.as_matrix(), covariance)
        if matches and log_p < math.log(settings.max_false_track):
            return refined(spots, finite, camera, stars, index, believed, rotation, 1.0, log_p)
    return identify(spots, camera, stars, index, settings)
