"""Matched directions -> attitude and covariance, by code that is not part of startrack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from startrack.core import POINTS, Floats, call_code, returned

GROUP = "attitudes"
EXACT = 1e-6  # largest element of R R^T - 1 of what is taken for a rotation matrix


@dataclass(frozen=True, eq=False)
class AttitudeInput:
    """Matched stars, of which an attitude is estimated.

    seen       (n, 3) unit vectors in camera axes, by the camera that the tracker believes
    direction  (n, 3) unit vectors of the same stars, ICRS axes
    sigma      (n,) radian, standard deviation of each per axis, its systematic part included
    """

    seen: Floats
    direction: Floats
    sigma: Floats


class AttitudeMethod(Protocol):
    """An estimator of one's own, which a design names in `tracker.attitude.method`.

    Returns  (3, 3) the rotation matrix icrs_to_camera; then startrack computes the covariance from
             the change of the attitude with each star. Or (6, 3): below it the covariance, radian^2
             about the camera's axes
    """

    def __call__(self, given: AttitudeInput, /) -> ArrayLike:
        """Estimate the attitude; outliers are its own concern."""


def attitude_by_code(name: str, given: AttitudeInput) -> tuple[Rotation, Floats]:
    """The attitude icrs_to_camera and its covariance (3, 3) of a function that a design names.

    Raises  ValueError where the function raises an error, or returns what it must not.
    """
    found = _estimated(name, given)
    attitude = Rotation.from_matrix(found[:3])
    if len(found) == 6:
        covariance = (found[3:] + found[3:].T) / 2
        if (np.linalg.eigvalsh(covariance) <= 0).any():
            raise ValueError(f"{POINTS[GROUP]} {name} must return a positive definite covariance")
        return attitude, covariance
    return attitude, _propagated(name, given, attitude)


def _estimated(name: str, given: AttitudeInput) -> Floats:
    found = returned(GROUP, name, call_code(GROUP, name, given), ((3, 6), 3))
    turn = found[:3]
    if np.abs(turn @ turn.T - np.eye(3)).max() > EXACT or np.linalg.det(turn) < 0:
        raise ValueError(f"{POINTS[GROUP]} {name} must return a rotation matrix, got {turn}")
    return found


def _propagated(name: str, given: AttitudeInput, attitude: Rotation) -> Floats:
    """Covariance by the noise of each star along two directions, to first order.

    C = sum_i r_i r_i^T,   r_i the rotation of the attitude when a direction moves by its sigma
    """
    total = np.zeros((3, 3))
    for n, (direction, sigma) in enumerate(zip(given.seen, given.sigma, strict=True)):
        least = np.eye(3)[np.abs(direction).argmin()]
        first = np.cross(direction, least)
        first /= np.linalg.norm(first)
        for across in (first, np.cross(direction, first)):
            moved = given.seen.copy()
            moved[n] += sigma * across
            moved[n] /= np.linalg.norm(moved[n])
            found = _estimated(name, AttitudeInput(moved, given.direction, given.sigma))
            turn = (Rotation.from_matrix(found[:3]) * attitude.inv()).as_rotvec()
            total += np.outer(turn, turn)
    return total
