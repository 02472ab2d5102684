"""Identification: tolerances of the camera and thresholds of the match, or user code."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import POSITIVE, Floats, Ints, Parameters, Range, parameter

METHODS = ("triangles",)


class Identification(Parameters):
    """Settings of the identification of spots, for calibrated cameras by default.

    The defaults are chosen by hand, for speed against success. experiments/identification.py and
    experiments/photographs.py show the success with them, but do not vary them.

    Raises                 ValueError if a value lies outside its range.
    """

    focal_tolerance: float = parameter(
        "allowed relative error of the focal length; 0: it is fixed, above 0: it is estimated "
        "with the attitude",
        limit=Range(0, 0.3),
        default=0.01,
    )
    match_radius: float = parameter(
        "pixel, largest distance between a spot and its star", limit=POSITIVE, default=2.0
    )
    max_false_probability: float = parameter(
        "largest bound on the probability that chance makes an accepted match",
        limit=Range(0, 1, above=True),
        default=1e-5,
    )
    max_false_track: float = parameter(
        "largest bound on the same probability with a predicted attitude; it is larger, because "
        "earlier frames have confirmed the prediction, and two stars are weak evidence",
        limit=Range(0, 1, above=True),
        default=1e-3,
    )
    min_matches: int = parameter(
        "fewest matched stars of an accepted match", limit=Range(4, 2**20), default=4
    )
    pattern_spots: int = parameter(
        "number of the brightest spots that form triangles first; the other spots of "
        "`verify_spots` follow",
        limit=Range(4, 40),
        default=24,
    )
    verify_spots: int = parameter(
        "number of the brightest spots that verify a hypothesis", limit=Range(4, 2**20), default=40
    )
    code_tolerance: float = parameter(
        "error of a triangle's code beyond the noise of the centroids, from distortion that the "
        "camera model lacks",
        limit=Range(0, 0.1),
        default=0.003,
    )
    max_hypotheses: int = parameter(
        "number of hypotheses after which the search ends without a match",
        limit=Range(1, 2**30),
        default=4000,
    )
    method: str = parameter(
        '"triangles": codes of triangles, which other spots verify; or user code, see '
        "docs/extensions.md. For user code, min_matches holds, and the other keys above only if "
        "the code reads them",
        limit=Range(choices=METHODS, code="identifications"),
        default="triangles",
    )


GROUP = "identifications"


@dataclass(frozen=True, eq=False)
class IdentificationInput:
    """Spots and the catalogue that a user's identification matches.

    seen        (n, 3) unit vectors of the spots in camera axes, brightest first, by the camera that
                the tracker assumes
    sigma       (n,) radian, standard deviation of each spot per axis
    flux        (n,) digital number
    stars       the tracker's catalogue: direction (m, 3) unit vectors in ICRS axes, magnitude_g
                (m,); the same object in each trial, so that functools.cache can keep what a method
                computes from it
    radius      radian, from the boresight to the corners of the frame
    settings    the other keys of tracker.identification
    predicted   (3, 3) icrs_to_camera that a tracker expects in a sequence; None: lost in space
    covariance  (3, 3) radian^2 of the prediction, about the camera's axes; None: lost in space

    The function returns (k, 2) whole numbers: index of a spot, index of its star; no index twice.
    It returns no rows if the sky is not identified.
    """

    seen: Floats
    sigma: Floats
    flux: Floats
    stars: core.Stars
    radius: float
    settings: Identification
    predicted: Floats | None
    covariance: Floats | None


def matches_by_code(
    spots: core.Spots,
    usable: Ints,
    camera: core.Camera,
    stars: core.Stars,
    settings: Identification,
    predicted: Rotation | None = None,
    covariance: Floats | None = None,
) -> core.Matches:
    """The matches of user code that a design names; arguments as for `identify` and `track`.

    usable   (n,) indices of the spots that may be matched
    Returns  Matches, with unknown (NaN) false probability; no match if the function matches fewer
             stars than `settings.min_matches`, or fewer than two with a prediction
    Raises   ValueError if the function raises an error, or returns an invalid result.
    """
    name, none = settings.method, np.empty(0, np.int64)
    fewest = settings.min_matches if predicted is None else 2
    nothing = none, none, np.empty((0, 3)), camera, None, math.nan
    if len(usable) < fewest:
        status = core.Status.TOO_FEW if len(usable) else core.Status.BLANK
        return core.Matches(status, f"{len(usable)} usable spots, {fewest} are needed", *nothing)
    seen = camera.unproject(np.column_stack([spots.x, spots.y])[usable])
    spread = np.trace(spots.covariance[usable], axis1=1, axis2=2) / 2
    given = IdentificationInput(
        seen=seen,
        sigma=np.sqrt(spread) / camera.focal_length_px,
        flux=spots.flux[usable],
        stars=stars,
        radius=camera.half_diagonal,
        settings=settings,
        predicted=None if predicted is None else predicted.as_matrix(),
        covariance=covariance,
    )
    answer = core.call_code(GROUP, name, given)
    pairs = core.returned(GROUP, name, answer, (-1, 2)) if np.size(answer) else np.empty((0, 2))
    spot, star = pairs.astype(np.int64).T
    _check(name, pairs, len(usable), len(stars))
    if len(pairs) < fewest:
        reason = f"{name} matches {len(pairs)} of {len(usable)} spots, {fewest} are needed"
        return core.Matches(core.Status.NO_MATCH, reason, *nothing)
    order = np.argsort(spot)
    spot, star = spot[order], star[order]
    attitude, _ = Rotation.align_vectors(seen[spot], stars.direction[star])
    reason = f"{len(pairs)} of {len(usable)} spots are stars of the catalogue by {name}"
    return core.Matches(
        *(core.Status.SOLVED, reason, usable[spot], star, stars.direction[star]),
        *(camera, attitude, math.nan),
    )


def _check(name: str, pairs: Floats, spots: int, stars: int) -> None:
    """Refuse indices out of range, and repeated indices."""
    asked = f"{core.POINTS[GROUP]} {name} must return"
    for column, most, what in zip(pairs.T, (spots, stars), ("spots", "stars"), strict=True):
        if (column != np.rint(column)).any() or ((column < 0) | (column >= most)).any():
            raise ValueError(f"{asked} indices of {what} from 0 to {most - 1}")
        if len(np.unique(column)) < len(column):
            raise ValueError(f"{asked} none of the {what} twice")
