"""Filtered attitude and gyroscope bias from attitudes in time and gyroscope rates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Floats, non_negative


@dataclass(frozen=True)
class Gyroscope:
    """The noise of a gyroscope's rates, the same on each axis.

    angle_random_walk  radian / sqrt(second), white noise of the rate
    rate_random_walk   radian / second^1.5, white noise that drives the bias
    """

    angle_random_walk: float
    rate_random_walk: float

    def __post_init__(self) -> None:
        non_negative(
            angle_random_walk=self.angle_random_walk, rate_random_walk=self.rate_random_walk
        )


@dataclass(frozen=True, eq=False)
class State:
    """Estimate of the filter at one instant.

    icrs_to_camera  attitude
    bias            (3,) radian / second, rate that the gyroscope measures at rest, camera axes
    covariance      (6, 6) of the small rotation about the camera's axes, radian, and of the bias
    """

    icrs_to_camera: Rotation
    bias: Floats
    covariance: Floats


def start(icrs_to_camera: Rotation, covariance: Floats, bias_sigma: float) -> State:
    """State from one attitude and a bias of zero.

    covariance  (3, 3) radian^2, of the small rotation about the camera's axes
    bias_sigma  radian / second, standard deviation of the bias per axis
    """
    full = np.zeros((6, 6))
    full[:3, :3] = covariance
    full[3:, 3:] = np.eye(3) * bias_sigma**2
    return State(icrs_to_camera, np.zeros(3), full)


def predict(state: State, rate: Floats, step: float, gyroscope: Gyroscope) -> State:
    """Propagate the state over a time step with a constant rate.

        A' = exp(-[t]x) A,   t = (rate - bias) step

    The stars rotate by -t in the axes of a camera that rotates by t. The error, a small rotation
    after A, rotates with them; an error b of the bias adds about b step.

    Source: Lefferts, Markley and Shuster (1982), J. Guidance 5(5), 417; the noise over a step is
    Farrenkopf's (1978), exact for a small turn.

    rate       (3,) radian / second, measured by the gyroscope, of the camera, in camera axes
    step       second
    """
    step_rotation = Rotation.from_rotvec(-(rate - state.bias) * step)
    carry = np.eye(6)
    carry[:3, :3] = step_rotation.as_matrix()
    carry[:3, 3:] = _mean_turn(-(rate - state.bias) * step) * step
    white, walk = gyroscope.angle_random_walk**2, gyroscope.rate_random_walk**2
    noise = np.kron(
        [
            [white * step + walk * step**3 / 3, walk * step**2 / 2],
            [walk * step**2 / 2, walk * step],
        ],
        np.eye(3),
    )
    return State(
        step_rotation * state.icrs_to_camera, state.bias, carry @ state.covariance @ carry.T + noise
    )


def correct(state: State, icrs_to_camera: Rotation, covariance: Floats) -> State:
    """Correct the state with an attitude measured from stars.

    The multiplicative extended Kalman filter: the innovation is the rotation vector from the
    predicted to the measured attitude, and the correction is a rotation. Joseph's form keeps the
    covariance positive definite. Source: Markley (2003), J. Guidance 26(2), 311.

    covariance  (3, 3) radian^2, of the measured attitude, about the camera's axes
    """
    innovation = (icrs_to_camera * state.icrs_to_camera.inv()).as_rotvec()
    prior = state.covariance
    gain = np.linalg.solve(prior[:3, :3] + covariance, prior[:3]).T
    change = gain @ innovation
    rest = np.eye(6)
    rest[:, :3] -= gain
    return State(
        Rotation.from_rotvec(change[:3]) * state.icrs_to_camera,
        state.bias + change[3:],
        rest @ prior @ rest.T + gain @ covariance @ gain.T,
    )


def _mean_turn(turn: Floats) -> Floats:
    """Mean over s in [0, 1] of the rotation matrix of s times a rotation vector (3,)."""
    x, y, z = turn
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = float(np.linalg.norm(turn))
    if angle < 1e-4:  # the next terms are 1e-12 and below
        return np.eye(3) + cross / 2 + cross @ cross / 6
    return (
        np.eye(3)
        + (1 - np.cos(angle)) / angle**2 * cross
        + (angle - np.sin(angle)) / angle**3 * cross @ cross
    )
