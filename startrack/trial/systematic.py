"""Case -> systematic variance of each star, which the tracker adds to that of the noise, and the
errors that stars share."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from startrack.attitude import UNKNOWN_FLOOR, SharedErrors
from startrack.catalog import open_sky
from startrack.core import Floats, Stars
from startrack.design import Case, Scope, found_at
from startrack.optics import residual_law
from startrack.trial.conditions import colour_correction, mean_colour, separable_stars
from startrack.trial.neighbours import blending_shift
from startrack.trial.star_errors import errors, lasting
from startrack.trial.zones import focal_stretch, lens_variance

TURNS = tuple(f"instrument.mounting.{axis}" for axis in "xyz")


def systematic_variance(case: Case) -> Floats:
    """Variance per axis of a centroid that no noise explains, as a tracker knows it
    that is calibrated and as designed.

        variance = S-curve^2 + PRNU^2 + DSNU^2 + shift^2 / 2 + lens^2 + residual^2

    the first three from the tracker's centroids of noise-free stars of that magnitude (`errors`);
    the shift is that by the neighbours in its catalogue (`blending_shift`), along one line and so
    half of its square on either axis; then what a lens table leaves to the tracker, over the frame,
    for a star of that colour (`lens_variance`), and where the case is a unit, the rms of its
    `Residual`, which its calibration sees. `centroid_floor` replaces all of it where it is given.

    Returns  (n,) pixel^2, for the stars of the believed catalogue
    Accuracy  those of `errors` and `blending_shift`. model: for a detector that scans, the tracker
              assumes UNKNOWN_FLOOR; what a residual changes by with temperature is not known to the
              tracker.
    """
    known = _systematic_variance(case.as_designed)
    residual = case.as_designed.instrument.residual if case.design else None
    if residual is None or case.tracker.attitude.centroid_floor is not None:
        return known
    return known + residual.rms**2


@lru_cache(maxsize=8)
def _systematic_variance(case: Case) -> Floats:
    stars, floor = open_sky(case.believed_catalog).stars, case.tracker.attitude.centroid_floor
    if floor is None and case.instrument.detector.scan:
        floor = UNKNOWN_FLOOR
    if floor is not None:
        return np.full(len(stars), floor**2)
    variance = lasting(errors(case), stars.magnitude_g + colour_correction(case, stars.colour)) ** 2
    catalog = case.believed_catalog
    name = separable_stars(catalog, case.instrument.camera).name
    variance[name] += (blending_shift(case, catalog) ** 2).sum(axis=1) / 2
    if case.instrument.optics.tabulated:
        variance += lens_variance(case, mean_colour(case, stars.colour))
    return variance


def shared_errors(case: Case) -> SharedErrors | None:
    """Errors that stars of a unit share, by the laws that its tracker knows, never by their draws.

    Those of the `Residual` that its calibration leaves, by rms and correlation length; and turns of
    the camera to the spacecraft that vary after the calibration: with environment and frame, at
    launch where it was calibrated on the ground, and from unit to unit where it never was.

    Returns  None where the case is as designed, or shares none
    Accuracy  model: what drifts over life, and what temperature changes of a residual, is not known
              to the tracker.
    """
    if case.design is None:
        return None
    return _shared_errors(case.as_designed)


@lru_cache(maxsize=8)
def _shared_errors(design: Case) -> SharedErrors | None:
    residual, camera = design.instrument.residual, design.believed_camera.ideal
    rms = residual.rms if residual and design.tracker.attitude.centroid_floor is None else 0.0
    turn = _turns(design)
    if not (rms or turn.any()):
        return None
    table = np.zeros((1, 1, 2, 1))
    if residual and rms:
        table = rms * residual_law(camera, residual.scale)
    return SharedErrors(camera.columns, camera.rows, table, rms**2, turn)


def _turns(design: Case) -> Floats:
    """Radian^2 (3,) about each axis."""
    calibration, turn = design.tracker.calibration, np.zeros(3)
    left = {Scope.ENVIRONMENT, Scope.FRAME}
    if calibration is None or calibration.place == "ground":
        left.add(Scope.LAUNCH)
    if calibration is None:
        left.add(Scope.UNIT)
    for one, law in zip(design.variation, design.laws, strict=True):
        if one.per in left and one.name in TURNS:
            size = found_at(design, one.name) if one.vary == "relative" else 1.0
            turn[TURNS.index(one.name)] += size**2 * law.mean_square()
    return turn


def focal_stretches(case: Case) -> Floats | None:
    """`focal_stretch` (n,) of the stars of the believed catalogue; None where all are zero."""
    return _focal_stretches(case.as_designed)


@lru_cache(maxsize=8)
def _focal_stretches(case: Case) -> Floats | None:
    if not case.tracker.focal_length_by_colour:
        return None
    return focal_stretch(case, mean_colour(case, open_sky(case.believed_catalog).stars.colour))


def systematic_variance_of(case: Case, stars: Stars) -> Floats:
    """`systematic_variance` (m,) of stars of the true sky; any value for those not believed in."""
    star, _ = open_sky(case.believed_catalog).stars.find(stars.identifier)
    return systematic_variance(case)[star]
