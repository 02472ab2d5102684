"""Design -> errors that remain after a camera's calibration: displacements, and rotations."""

import numpy as np

from startrack.core import Floats, kept
from startrack.design import Case, Scope, found_at
from startrack.optics import Residual

TURNS = tuple(f"instrument.mounting.{axis}" for axis in "xyz")
_law = kept(8)(Residual.law)  # cached for the last 8 designs, at all slew rates


def residual_law(design: Case) -> Floats:
    """`Residual.law` (33, 33, 2, k) of the errors that remain after the calibration of units."""
    instrument, calibration = design.instrument, design.tracker.calibration
    if instrument.residual is None:
        return np.zeros((1, 1, 2, 1))
    return _law(
        instrument.residual,
        design.believed_camera.ideal,
        instrument.optics,
        instrument.detector.pitch,
        calibration.order if calibration else 0,
        calibration.tangential if calibration else False,
        calibration.nodes if calibration else 0,
    )


def map_noise(design: Case) -> float:
    """Pixel^2, variance of a camera's calibration map by the noise of the calibration."""
    calibration = design.tracker.calibration
    if calibration is None or not calibration.nodes:
        return 0.0
    ground = calibration.place == "ground"
    places = calibration.positions if ground else calibration.frames * calibration.stars
    noise = calibration.noise**2
    if ground:
        noise += (calibration.direction * design.believed_camera.focal_length_px) ** 2
    return noise * calibration.nodes**2 / places


def remaining_turns(design: Case) -> Floats:
    """Variance (3,), radian^2 about each axis, of rotations of the camera after its calibration.

    The rotations vary with the environment and from frame to frame. They also vary at launch if the
    camera was calibrated on the ground, and from unit to unit if it was never calibrated.
    """
    calibration, turn = design.tracker.calibration, np.zeros(3)
    left = {Scope.ENVIRONMENT, Scope.FRAME}  # a recursive calibration does not follow these
    if calibration is None or calibration.place == "ground":
        left.add(Scope.LAUNCH)
    if calibration is None:
        left.add(Scope.UNIT)
    for variation, law in zip(design.varying, design.laws, strict=True):
        if variation.per in left and variation.name in TURNS:
            size = found_at(design, variation.name) if variation.vary == "relative" else 1.0
            turn[TURNS.index(variation.name)] += size**2 * law.mean_square()
    return turn
