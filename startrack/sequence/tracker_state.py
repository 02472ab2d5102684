"""Attitudes of the heads -> the state of the tracker between two frames, and its predictions."""

from __future__ import annotations

import collections.abc
import math
from dataclasses import dataclass, field, replace

import numpy as np

from startrack import attitude, core
from startrack.attitude import start
from startrack.core import Floats
from startrack.sequence.parameters import Sequence

GATE = 30.7  # chi-square of 3 degrees of freedom, exceeded once in a million by noise alone
FASTEST = 10.0  # sigma of the rate at the start: largest rate that two frames may show
Estimates = collections.abc.Sequence[core.Estimate]


@dataclass(frozen=True, eq=False)
class TrackerState:
    """State of the tracker between two frames.

    state   of the filter; None before the first attitude and, without a gyroscope, after a loss
            lasting (heads, 3, 3, 3) radian^2, lasting part of each head's last attitude error, as
            `lasting_parts`
    missed  number of frames since the last one whose attitude was used
    fresh   whether the last frame started the filter, or ended a loss
    lost    whether too many frames were missed to predict the attitude; the filter of a gyroscope
            continues, so that its bias and its axes stay known
    """

    state: attitude.State | None = None
    lasting: Floats = field(default_factory=lambda: np.zeros((1, 3, 3, 3)))
    missed: int = 0
    fresh: bool = False
    lost: bool = False

    @property
    def predicted(self) -> attitude.State | None:
        """The state around which the tracker searches for stars; None without a known attitude."""
        return None if self.lost else self.state


def predict_state(
    tracker: TrackerState, shown: Floats | None, step: float, sequence: Sequence, lengths: Floats
) -> TrackerState:
    """Predict the state at the next frame.

    Without a gyroscope the filter assumes a gyroscope that reads zero: its bias is then minus the
    camera's rate, and its random walk the angular acceleration.

    shown    (3,) radian / second, output of the gyroscope; None without one
    step     second
    lengths  (2,) radian, of `error_lengths`
    """
    if tracker.state is None:
        return tracker
    gyro, walks = sequence.gyro, (0.0, sequence.angular_acceleration_psd)
    if gyro:
        walks = gyro.angle_random_walk, gyro.rate_random_walk
    rate = np.zeros(3) if shown is None else shown
    turn, keep = tracker.state.rate_of(rate) * step, []
    for head in range(len(tracker.lasting)):
        x, y, z = np.abs(tracker.state.to_head(head).apply(turn))
        # A turn about x moves stars along y; a turn about z moves stars off the middle along both.
        along = lengths[1] / 2 * z
        moved = np.array([y + along, x + along, np.hypot(x, y) + z / 2])
        keep.append(np.exp(-moved / lengths[[0, 0, 1]]))
    errors = attitude.LastingErrors(tracker.lasting.reshape(-1, 3, 3), np.concatenate(keep))
    return replace(
        tracker,
        state=attitude.predict(tracker.state, rate, step, attitude.Gyroscope(*walks), errors),
    )


def doubted(
    before: TrackerState, predicted: TrackerState, step: float, sequence: Sequence, lengths: Floats
) -> TrackerState:
    """The prediction for a frame without an attitude, if the frame before had one.

    An unannounced manoeuvre may have begun: without a gyroscope, the rate may have changed by
    `initial_rate_sigma` at some time since the frame before.

    before     the state at that frame
    predicted  the prediction, which holds with a gyroscope and in later frames
    """
    if sequence.gyro or before.state is None or before.missed or not step:
        return predicted
    manoeuvre = sequence.initial_rate_sigma / math.sqrt(step)
    psd = math.hypot(sequence.angular_acceleration_psd, manoeuvre)
    restless = replace(sequence, angular_acceleration_psd=psd)
    return predict_state(before, None, step, restless, lengths)


def known_rate(state: attitude.State | None, shown: Floats | None) -> Floats:
    """Rate of the camera (3,), radian / second, that the tracker knows in an exposure.

    It is the gyroscope's rate without estimated errors, or the filter's rate; zero without both.

    shown  (3,) radian / second, of the gyroscope; None without one
    """
    rate = np.zeros(3) if shown is None else shown
    return rate if state is None else state.rate_of(rate)


def update_state(
    tracker: TrackerState,
    estimates: Estimates,
    sequence: Sequence,
    parts: Floats,
    moved: Floats | None = None,
) -> TrackerState:
    """Update with the attitudes of all heads, or coast for at most `max_coasted_frames` frames.

    An attitude that contradicts the prediction is left out if an attitude of another head agrees
    with it. If none agrees, the first attitude restarts the filter, because it was measured and the
    prediction was not. A prediction by a gyroscope was measured, too: then the frames count as
    missed.

    estimates  of the frames of one time, one for each head
    parts      (heads, 3, 3, 3) of the covariance of each attitude, as `lasting_parts`
    moved      (3,) radian^2 about the axes of a camera: the motion of the platform in an exposure,
               which all heads share and each covariance includes; None: no motion
    """
    own = np.zeros((3, 3)) if moved is None else np.diag(moved)
    state, solved = tracker.state, solved_heads(estimates)
    agreeing = [head for head in solved if state and not _contradicts(state, estimates[head], head)]
    measured = state is not None and sequence.gyro and not tracker.lost and not tracker.fresh
    if not solved or (measured and not agreeing):
        missed = tracker.missed + 1
        lost = missed > sequence.max_coasted_frames
        if lost and not sequence.gyro:
            return TrackerState()
        return replace(tracker, missed=missed, fresh=False, lost=lost)
    fresh, lasting = tracker.lost, tracker.lasting.copy()
    if state is None or not agreeing:
        head, *others = solved
        first = replace(estimates[head], covariance=estimates[head].covariance - own)
        state = _started(first, sequence, parts[head], head)
        # Until the other heads have measured an attitude, their errors are assumed equal.
        fresh, lasting = True, np.array([parts[head]] * len(estimates))
        agreeing = [k for k in others if not _contradicts(state, estimates[k], k)]
        # For a first attitude, common errors add to independent ones.
        state = _corrected(state, estimates, agreeing, parts, own, None)
        covariance = state.covariance.copy()
        covariance[:3, :3] += own
        state = replace(state, covariance=covariance)
    else:
        state = _corrected(state, estimates, agreeing, parts, own, own)
    for head in agreeing:
        lasting[head] = parts[head]
    return TrackerState(state, lasting, fresh=fresh)


def _corrected(
    state: attitude.State,
    estimates: Estimates,
    heads: list[int],
    parts: Floats,
    own: Floats,
    shared: Floats | None,
) -> attitude.State:
    """The state corrected by the attitudes of some heads; `own` is in each of their covariances."""
    measured = []
    for head in heads:
        estimate = estimates[head]
        assert estimate.icrs_to_camera is not None
        new = estimate.covariance - parts[head].sum(axis=0) - own
        measured.append(attitude.MeasuredAttitude(estimate.icrs_to_camera, new, head))
    return attitude.correct_together(state, measured, shared) if measured else state


def _started(
    estimate: core.Estimate, sequence: Sequence, parts: Floats, head: int
) -> attitude.State:
    """The state from the first attitude, of a head."""
    assert estimate.icrs_to_camera is not None
    gyro, heads = sequence.gyro, sequence.heads
    errors = attitude.LastingErrors(np.concatenate([parts] * (1 + len(heads))), np.ones(()))
    return start(
        estimate.icrs_to_camera,
        estimate.covariance,
        gyro.bias if gyro else sequence.initial_rate_sigma,
        errors,
        gyro.misalignment if gyro else 0.0,
        [(other.to_head, other.alignment_sigma) for other in heads],
        head,
    )


def from_two_frames(
    before: TrackerState,
    estimate: core.Estimate,
    head: int,
    step: float,
    sequence: Sequence,
    lengths: Floats,
) -> TrackerState:
    """The prediction of a frame by the rate between its attitude and the attitude of the frame
    before.

    A filter without gyroscope knows its rate after one frame only within `initial_rate_sigma` about
    zero. The second attitude determines the rate: the prediction is made again with it, and the
    update weights both.

    before  the state after the first attitude
    head    that measured the second one
    step    second, since then
    """
    assert before.state is not None
    assert estimate.icrs_to_camera is not None
    now = before.state.to_head(head).inv() * estimate.icrs_to_camera
    turned = (now * before.state.icrs_to_camera.inv()).as_rotvec()
    if float(np.linalg.norm(turned)) > FASTEST * sequence.initial_rate_sigma * step:
        return predict_state(before, None, step, sequence, lengths)
    at_rate = replace(before, state=replace(before.state, bias=turned / step))
    return predict_state(at_rate, None, step, sequence, lengths)


def solved_heads(estimates: Estimates) -> list[int]:
    """The heads that have an attitude."""
    return [
        head
        for head, estimate in enumerate(estimates)
        if estimate.status is core.Status.SOLVED and estimate.icrs_to_camera is not None
    ]


def _contradicts(state: attitude.State, estimate: core.Estimate, head: int) -> bool:
    assert estimate.icrs_to_camera is not None
    predicted, covariance = state.seen_by(head)
    innovation = (estimate.icrs_to_camera * predicted.inv()).as_rotvec()
    spread = covariance + estimate.covariance
    return bool(innovation @ np.linalg.solve(spread, innovation) > GATE)
