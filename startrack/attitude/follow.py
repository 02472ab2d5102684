"""Filtered attitude, gyroscope and lasting errors from attitudes and rates in time."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import NON_NEGATIVE, Floats, Parameters


@dataclass(frozen=True)
class Gyroscope(Parameters):
    """The noise of a gyroscope's rates, the same on each axis."""

    angle_random_walk: Annotated[float, NON_NEGATIVE,
        "radian / sqrt(second), white noise of the rate"]  # fmt: skip
    rate_random_walk: Annotated[float, NON_NEGATIVE,
        "radian / second^1.5, white noise that drives the bias"]  # fmt: skip


@dataclass(frozen=True, eq=False)
class State:
    """Estimate of the filter at one instant.

    icrs_to_camera  attitude
    bias            (3,) radian / second, rate that the gyroscope measures at rest, in its axes
    covariance      (n, n) of the small rotation about the camera's axes, radian, of the bias, of
                    the lasting errors and of the misalignment: n = 6 + 3 k + m
    lasting         (k, 3) radian, errors of the measured attitudes that last from frame to frame
    misalignment    (m,) radian, rotation from the camera's axes to the gyroscope's: three angles,
                    or none where the gyroscope has the axes of the camera
    """

    icrs_to_camera: Rotation
    bias: Floats
    covariance: Floats
    lasting: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    misalignment: Floats = field(default_factory=lambda: np.zeros(0))

    def rate_of(self, shown: Floats) -> Floats:
        """Rate (3,) of the camera, radian / second, where the gyroscope shows another."""
        rate = shown - self.bias
        if not len(self.misalignment):
            return rate
        return np.asarray(Rotation.from_rotvec(-self.misalignment).apply(rate))


@dataclass(frozen=True, eq=False)
class Lasting:
    """Parts of the error of a measured attitude that are correlated in time (Gauss-Markov).

    covariance  (k, 3, 3) radian^2 about the camera's axes, of each part, within that of the
                measurement
    keep        (k, 3) 1, correlation of each part with that of the frame before, about each axis
    """

    covariance: Floats
    keep: Floats


def start(
    icrs_to_camera: Rotation,
    covariance: Floats,
    bias_sigma: float,
    lasting: Lasting | None = None,
    misalignment_sigma: float = 0.0,
) -> State:
    """State from one attitude, with a bias, lasting errors and a misalignment of zero.

    covariance  (3, 3) radian^2, of the small rotation about the camera's axes
    bias_sigma  radian / second, standard deviation of the bias per axis
    lasting     parts of that covariance; None: all of it is new with each attitude
    misalignment_sigma  radian, standard deviation per axis; 0: the gyroscope has none
    """
    parts = np.zeros((0, 3, 3)) if lasting is None else lasting.covariance
    misalignment = np.zeros(3 if misalignment_sigma else 0)
    full = np.zeros((6 + 3 * len(parts) + len(misalignment),) * 2)
    last = len(full) - len(misalignment)
    full[last:, last:] = np.eye(len(misalignment)) * misalignment_sigma**2
    full[:3, :3] = covariance
    full[3:6, 3:6] = np.eye(3) * bias_sigma**2
    for k, part in enumerate(parts):
        # The attitude has this error, and the state says that there is none.
        place = slice(6 + 3 * k, 9 + 3 * k)
        full[place, place] = part
        full[:3, place], full[place, :3] = -part, -part
    return State(icrs_to_camera, np.zeros(3), full, np.zeros((len(parts), 3)), misalignment)


def predict(
    state: State, rate: Floats, step: float, gyroscope: Gyroscope, lasting: Lasting | None = None
) -> State:
    """Propagate the state over a time step with a constant rate.

        A' = exp(-[t]x) A,   t = exp(-[m]x) (rate - bias) step

    The stars rotate by -t in the axes of a camera that rotates by t. The error, a small rotation
    after A, rotates with them; an error b of the bias adds about b step, one of the misalignment m
    about m x t.

    Source: Lefferts, Markley and Shuster (1982), J. Guidance 5(5), 417; the noise over a step is
    Farrenkopf's (1978), exact for a small turn.

    rate       (3,) radian / second, of the camera, as the gyroscope shows it
    step       second
    lasting    how the lasting errors of the state go on; None: it has none
    """
    turn = state.rate_of(rate) * step
    step_rotation = Rotation.from_rotvec(-turn)
    carry = np.eye(len(state.covariance))
    carry[:3, :3] = step_rotation.as_matrix()
    carry[:3, 3:6] = _mean_turn(-turn) * step
    if len(state.misalignment):
        carry[:3, -3:] = -_mean_turn(-turn) @ _cross(turn)
    white, walk = gyroscope.angle_random_walk**2, gyroscope.rate_random_walk**2
    noise = np.zeros_like(carry)
    noise[:6, :6] = np.kron(
        [
            [white * step + walk * step**3 / 3, walk * step**2 / 2],
            [walk * step**2 / 2, walk * step],
        ],
        np.eye(3),
    )
    errors = state.lasting
    for k in range(len(errors)):
        assert lasting is not None
        place, keep = slice(6 + 3 * k, 9 + 3 * k), lasting.keep[k]
        carry[place, place] = np.diag(keep)
        fresh = np.sqrt(1 - keep**2)
        noise[place, place] = lasting.covariance[k] * np.outer(fresh, fresh)
        errors = errors * 1.0
        errors[k] *= keep
    covariance = carry @ state.covariance @ carry.T + noise
    return State(
        step_rotation * state.icrs_to_camera, state.bias, covariance, errors, state.misalignment
    )


def correct(state: State, icrs_to_camera: Rotation, covariance: Floats) -> State:
    """Correct the state with an attitude measured from stars.

    The multiplicative extended Kalman filter: the innovation is the rotation vector from the
    predicted to the measured attitude, and the correction is a rotation. Joseph's form keeps the
    covariance positive definite. Source: Markley (2003), J. Guidance 26(2), 311.

    covariance  (3, 3) radian^2, of the measured attitude, about the camera's axes; without that of
                the lasting errors of the state
    """
    innovation = (icrs_to_camera * state.icrs_to_camera.inv()).as_rotvec()
    innovation -= state.lasting.sum(axis=0)
    prior, many = state.covariance, len(state.lasting)
    unseen = np.zeros((3, len(state.misalignment)))
    seen = np.hstack([np.eye(3), np.zeros((3, 3)), *[np.eye(3)] * many, unseen])
    gain = np.linalg.solve(seen @ prior @ seen.T + covariance, seen @ prior).T
    change = gain @ innovation
    rest = np.eye(len(prior)) - gain @ seen
    return State(
        Rotation.from_rotvec(change[:3]) * state.icrs_to_camera,
        state.bias + change[3:6],
        rest @ prior @ rest.T + gain @ covariance @ gain.T,
        state.lasting + change[6 : 6 + 3 * many].reshape(many, 3),
        state.misalignment + change[6 + 3 * many :],
    )


def _mean_turn(turn: Floats) -> Floats:
    """Mean over s in [0, 1] of the rotation matrix of s times a rotation vector (3,)."""
    cross = _cross(turn)
    angle = float(np.linalg.norm(turn))
    if angle < 1e-4:  # the next terms are 1e-12 and below
        return np.eye(3) + cross / 2 + cross @ cross / 6
    return (
        np.eye(3)
        + (1 - np.cos(angle)) / angle**2 * cross
        + (angle - np.sin(angle)) / angle**3 * cross @ cross
    )


def _cross(vector: Floats) -> Floats:
    """The matrix (3, 3) whose product with a vector is the cross product with it."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
