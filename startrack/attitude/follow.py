"""Attitudes in time and the rates of a gyroscope into a filtered attitude and the rates' bias."""

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
    """What the filter knows.

    icrs_to_camera  attitude
    bias            (3,) radian / second, what the gyroscope shows at rest, camera axes
    covariance      (6, 6) of the small rotation about the camera's axes, radian, and of the bias
    """

    icrs_to_camera: Rotation
    bias: Floats
    covariance: Floats


def start(icrs_to_camera: Rotation, covariance: Floats, bias_sigma: float) -> State:
    """Begin with one attitude (its covariance (3, 3) radian^2) and a bias of zero +- bias_sigma."""
    full = np.zeros((6, 6))
    full[:3, :3] = covariance
    full[3:, 3:] = np.eye(3) * bias_sigma**2
    return State(icrs_to_camera, np.zeros(3), full)


def predict(state: State, rate: Floats, step: float, gyroscope: Gyroscope) -> State:
    """Carry the state over a time step, in which the rate is constant.

    A camera that turns by the vector t sees the sky turn by -t: A' = exp(-[t]x) A with
    t = (rate - bias) step. The error, the small rotation after A, turns along, and a bias that is
    believed too small leaves the sky turned back too far.

    Source: Lefferts, Markley and Shuster (1982), J. Guidance 5(5), 417; the noise over a step is
    Farrenkopf's (1978), exact for a small turn.

    rate       (3,) radian / second, as the gyroscope shows it, of the camera, in camera axes
    step       second
    gyroscope  its noise
    """
    sky = Rotation.from_rotvec(-(rate - state.bias) * step)
    carry = np.eye(6)
    carry[:3, :3] = sky.as_matrix()
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
        sky * state.icrs_to_camera,
        state.bias,
        carry @ state.covariance @ carry.T + noise,
    )


def correct(state: State, icrs_to_camera: Rotation, covariance: Floats) -> State:
    """Take in an attitude that the stars gave.

    The multiplicative extended Kalman filter: the innovation is the rotation vector from the
    predicted to the seen attitude, the correction is multiplied on. Joseph's form keeps the
    covariance positive. Source: Markley (2003), J. Guidance 26(2), 311.

    covariance  (3, 3) radian^2, of the small rotation about the camera's axes
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
