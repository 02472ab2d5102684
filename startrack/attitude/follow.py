"""Kalman filter: attitudes and rates in time -> attitude, gyroscope bias, alignments, errors."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from startrack.core import NON_NEGATIVE, Floats, Parameters, parameter


class Gyroscope(Parameters):
    """The noise of a gyroscope's rates, the same on each axis."""

    angle_random_walk: float = parameter(
        "radian / sqrt(second), white noise of the rate", limit=NON_NEGATIVE
    )
    rate_random_walk: float = parameter(
        "radian / second^1.5, white noise that drives the bias", limit=NON_NEGATIVE
    )


@dataclass(frozen=True, eq=False)
class State:
    """Estimate of the filter at one instant.

    icrs_to_camera  attitude
    bias            (3,) radian / second, rate that the gyroscope shows at rest, in its axes
    covariance      (n, n) of the small rotation about the camera's axes (radian), of the bias, of
                    the lasting errors, of the alignment of each further head about its axes, and of
                    the misalignment: n = 6 + 3 k + 3 h + m
    lasting         (k, 3) radian, errors of the measured attitudes that last from frame to frame,
                    about the axes of the head; head by head, the same number for each head
    misalignment    (m,) radian, rotation from the camera's axes to the gyroscope's axes: three
                    angles, or none if the gyroscope has the axes of the camera
    to_heads        (h,) rotations from the camera, which is head 0, to each further head
    """

    icrs_to_camera: Rotation
    bias: Floats
    covariance: Floats
    lasting: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    misalignment: Floats = field(default_factory=lambda: np.zeros(0))
    to_heads: tuple[Rotation, ...] = ()

    def rate_of(self, shown: Floats) -> Floats:
        """Rate (3,) of the camera, radian / second, from the rate that the gyroscope shows."""
        rate = shown - self.bias
        if not len(self.misalignment):
            return rate
        return np.asarray(Rotation.from_rotvec(-self.misalignment).apply(rate))

    def to_head(self, head: int) -> Rotation:
        """The rotation from the camera to a head."""
        return self.to_heads[head - 1] if head else Rotation.identity()

    def seen_by(self, head: int) -> tuple[Rotation, Floats]:
        """Attitude icrs_to_head, and its covariance (3, 3) about the head's axes, radian^2."""
        turns = self.turns(head)
        return self.to_head(head) * self.icrs_to_camera, turns @ self.covariance @ turns.T

    def alignment(self, head: int) -> slice:
        """The rows of the covariance for the alignment of a further head."""
        begin = 3 + 3 * len(self.lasting) + 3 * head
        return slice(begin, begin + 3)

    def turns(self, head: int) -> Floats:
        """Derivatives (3, n) of a head's attitude by the errors of the state."""
        turns = np.zeros((3, len(self.covariance)))
        turns[:, :3] = self.to_head(head).as_matrix()
        if head:
            turns[:, self.alignment(head)] = np.eye(3)
        return turns

    def measured(self, head: int) -> Floats:
        """Derivatives (3, n) of an attitude that a head measures, including its lasting errors."""
        many = len(self.lasting) // (1 + len(self.to_heads))
        measured = self.turns(head)
        begin = 6 + 3 * many * head
        measured[:, begin : begin + 3 * many] = np.tile(np.eye(3), many)
        return measured


@dataclass(frozen=True, eq=False)
class LastingErrors:
    """Parts of the error of a measured attitude that are correlated in time (Gauss-Markov).

    covariance  (k, 3, 3) radian^2 about the camera's axes, of each part; the covariance of the
                measurement contains it
    keep        (k,) 1, correlation of each part from one frame to the next
    """

    covariance: Floats
    keep: Floats


def start(
    icrs_to_head: Rotation,
    covariance: Floats,
    bias_sigma: float,
    lasting: LastingErrors | None = None,
    misalignment_sigma: float = 0.0,
    heads: Sequence[tuple[Rotation, float]] = (),
    head: int = 0,
) -> State:
    """State from one attitude, with a bias, lasting errors and a misalignment of zero.

    covariance  (3, 3) radian^2, of the small rotation about the axes of the head that measured it
    bias_sigma  radian / second, standard deviation of the bias per axis
    lasting     parts of `covariance`, for each head; None: all attitudes have independent errors
    misalignment_sigma  radian, standard deviation per axis; 0: the gyroscope has no misalignment
    heads       for each further head: the rotation from the camera to this head, and its standard
                deviation about each axis of the head, radian
    head        number of the head that measured the attitude; 0: the camera
    """
    parts = np.zeros((0, 3, 3)) if lasting is None else lasting.covariance
    many = len(parts) // (1 + len(heads))
    new = covariance - parts[many * head : many * (head + 1)].sum(axis=0)
    sigmas = [sigma for _, sigma in heads] + [misalignment_sigma] * bool(misalignment_sigma)
    apart = block_diag(
        new, np.eye(3) * bias_sigma**2, *parts, *(np.eye(3) * sigma**2 for sigma in sigmas)
    )
    camera, zeros = Rotation.identity(), np.zeros(3)
    state = State(
        camera,
        zeros,
        apart,
        np.zeros((len(parts), 3)),
        zeros[: 3 * bool(misalignment_sigma)],
        tuple(to_head for to_head, _ in heads),
    )
    # The attitude contains the lasting errors, but the state starts with lasting errors of zero.
    back = state.to_head(head).inv()
    errors = state.measured(head)
    errors[:, :3] = np.eye(3)
    carry = np.eye(len(apart))
    carry[:3] = -back.as_matrix() @ errors
    full = carry @ apart @ carry.T
    return replace(state, icrs_to_camera=back * icrs_to_head, covariance=full)


def predict(
    state: State,
    rate: Floats,
    step: float,
    gyroscope: Gyroscope,
    lasting: LastingErrors | None = None,
) -> State:
    """Propagate the state over a time step with a constant rate.

        A' = exp(-[t]x) A,   t = exp(-[m]x) (rate - bias) step

    If the camera rotates by t, the stars rotate by -t in its axes. The error, a small rotation
    after A, rotates with the stars. An error b of the bias adds about b step, and an error m of the
    misalignment adds about m x t.

    Source: Lefferts, Markley and Shuster (1982), J. Guidance 5(5), 417. The noise over a step is
    from Farrenkopf (1978); it is exact for a small rotation.

    rate       (3,) radian / second, rate of the camera that the gyroscope shows
    step       second
    lasting    law of the lasting errors of the state; None: there are none
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
        carry[place, place] = np.eye(3) * keep
        noise[place, place] = lasting.covariance[k] * (1 - keep**2)
        errors = errors * 1.0
        errors[k] *= keep
    covariance = carry @ state.covariance @ carry.T + noise
    turned = step_rotation * state.icrs_to_camera
    return replace(state, icrs_to_camera=turned, covariance=covariance, lasting=errors)


class MeasuredAttitude(NamedTuple):
    """An attitude that a head measured from stars.

    covariance  (3, 3) radian^2, about the axes of the head; without the lasting errors of the
                state, and without errors that all heads share
    head        number of the head; 0: the camera
    """

    icrs_to_head: Rotation
    covariance: Floats
    head: int = 0


def correct(state: State, icrs_to_head: Rotation, covariance: Floats, head: int = 0) -> State:
    """Correct the state with an attitude that one head measured, as in `MeasuredAttitude`."""
    return correct_together(state, [MeasuredAttitude(icrs_to_head, covariance, head)])


def correct_together(
    state: State, measured: Sequence[MeasuredAttitude], shared: Floats | None = None
) -> State:
    """Correct the state with attitudes that heads measured from stars at one time.

    This is the multiplicative extended Kalman filter: the innovation is the rotation vector from
    the predicted to the measured attitude, and the correction is a rotation. Joseph's form keeps
    the covariance positive definite.

    Source: Markley (2003), J. Guidance 26(2), 311.

    shared  (3, 3) radian^2 about the axes of the camera, of errors that all of these attitudes
            share, such as motion of the platform within the exposures; None: none
    """
    prior = state.covariance
    many, heads = len(state.lasting), len(state.to_heads)
    seen = np.concatenate([state.measured(head) for _, _, head in measured])
    covariance = block_diag(*(own for _, own, _ in measured))
    if shared is not None:
        turned = np.concatenate([state.to_head(head).as_matrix() for _, _, head in measured])
        covariance = covariance + turned @ shared @ turned.T
    innovation = np.concatenate(
        [
            (icrs_to_head * (state.to_head(head) * state.icrs_to_camera).inv()).as_rotvec()
            - state.lasting.reshape(1 + heads, -1, 3)[head].sum(axis=0)
            for icrs_to_head, _, head in measured
        ]
    )
    gain = np.linalg.solve(seen @ prior @ seen.T + covariance, seen @ prior).T
    change = gain @ innovation
    rest = np.eye(len(prior)) - gain @ seen
    last = 6 + 3 * many + 3 * heads
    turns = change[6 + 3 * many : last].reshape(heads, 3)
    return State(
        Rotation.from_rotvec(change[:3]) * state.icrs_to_camera,
        state.bias + change[3:6],
        rest @ prior @ rest.T + gain @ covariance @ gain.T,
        state.lasting + change[6 : 6 + 3 * many].reshape(many, 3),
        state.misalignment + change[last:],
        tuple(
            Rotation.from_rotvec(turn) * to_head
            for turn, to_head in zip(turns, state.to_heads, strict=True)
        ),
    )


def _mean_turn(turn: Floats) -> Floats:
    """Mean of the rotation matrix of s times a rotation vector (3,), over s in [0, 1]."""
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
