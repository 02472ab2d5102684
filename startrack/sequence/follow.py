"""One frame's attitude and the filter's state -> the filter's next state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from startrack.attitude import Gyroscope, State, correct, predict, start
from startrack.core import Estimate, Floats, Status
from startrack.sequence.parameters import Sequence

GATE = 30.7  # chi-square of 3 degrees of freedom, exceeded once in a million by noise alone


@dataclass(frozen=True, eq=False)
class TrackerState:
    """State of the tracker between two frames.

    state   of the filter, None without any attitude yet, or after a loss
    missed  frames without attitude since the last one
    fresh   whether the last frame started the filter
    """

    state: State | None = None
    missed: int = 0
    fresh: bool = False


def predict_state(
    known: TrackerState, shown: Floats | None, step: float, sequence: Sequence
) -> TrackerState:
    """Predict the state at the next frame.

    Without a gyroscope the filter assumes one that reads zero: its bias is then minus the rate of
    the camera, and its random walk the angular acceleration.

    shown  (3,) radian / second, output of the gyroscope; None without one
    step   second
    """
    if known.state is None:
        return known
    gyro = sequence.gyro
    believed = (
        Gyroscope(0.0, sequence.angular_acceleration_psd)
        if gyro is None
        else Gyroscope(gyro.angle_random_walk, gyro.rate_random_walk)
    )
    rate = np.zeros(3) if shown is None else shown
    return replace(known, state=predict(known.state, rate, step, believed))


def known_rate(state: State | None, shown: Floats | None) -> Floats:
    """Rate of the camera (3,), radian / second, that the tracker knows in an exposure.

    That of its gyroscope less the estimated bias, or of its filter; zero where it has neither.

    shown  (3,) radian / second, of the gyroscope; None without one
    """
    rate = np.zeros(3) if shown is None else shown
    return rate if state is None else rate - state.bias


def update_state(known: TrackerState, estimate: Estimate, sequence: Sequence) -> TrackerState:
    """Update with the attitude of a frame, or coast for at most `max_coasted_frames` frames.

    An attitude that contradicts the prediction restarts the filter, because stars were measured
    and the prediction was not.
    """
    if estimate.status is not Status.SOLVED or estimate.icrs_to_camera is None:
        missed = known.missed + 1
        return (
            TrackerState()
            if missed > sequence.max_coasted_frames
            else replace(known, missed=missed, fresh=False)
        )
    if known.state is None or _contradicts(known.state, estimate):
        sigma = sequence.initial_rate_sigma if sequence.gyro is None else sequence.gyro.bias
        return TrackerState(start(estimate.icrs_to_camera, estimate.covariance, sigma), fresh=True)
    return TrackerState(correct(known.state, estimate.icrs_to_camera, estimate.covariance))


def _contradicts(state: State, estimate: Estimate) -> bool:
    assert estimate.icrs_to_camera is not None
    innovation = (estimate.icrs_to_camera * state.icrs_to_camera.inv()).as_rotvec()
    spread = state.covariance[:3, :3] + estimate.covariance
    return bool(innovation @ np.linalg.solve(spread, innovation) > GATE)
