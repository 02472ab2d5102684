"""Case and sequence -> a table with a row for each frame."""

from __future__ import annotations

import math
import typing
from concurrent.futures import Executor
from enum import IntEnum
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import attitude, core, observation
from startrack.core import Advance, Rows
from startrack.design import Case, Fidelity
from startrack.metrics import Outcome, judge
from startrack.sequence.flight import SequenceFlight, exposure_rates, flight, gyro_rates
from startrack.sequence.head import FlownHead, heads_of
from startrack.sequence.lasting import error_lengths
from startrack.sequence.parameters import Sequence
from startrack.sequence.recording import Recording
from startrack.sequence.tracker_state import (
    TrackerState,
    doubted,
    from_two_frames,
    known_rate,
    predict_state,
    solved_heads,
    update_state,
)

AXES = "xyz"
MEAN_POINTS = 64  # points in an exposure for its mean attitude
# A row of the table of a sequence: one frame of one head.
OF_FILTER = ("filtered", "filtered_sigma", "alignment", "alignment_sigma")
FRAMES: np.dtype[np.void] = np.dtype(
    [
        ("sequence", np.int64),
        ("head", np.int8),
        ("time", float),
        ("rate", float),
        ("mode", np.int8),
        *typing.get_type_hints(Outcome).items(),
        *((f"{name}_{axis}", float) for name in OF_FILTER for axis in AXES),
    ]
)


class Mode(IntEnum):
    """Mode by which the tracker obtained its attitude after a frame."""

    SEARCHING = 0  # no prediction, not solved
    ACQUIRED = 1  # solved without a prediction, or against it
    TRACKED = 2  # solved, as predicted, by one head at least
    COASTED = 3  # not solved, or contradicts a gyroscope: prediction alone


def run(
    case: Case,
    sequence: Sequence,
    seed: int,
    number: int,
    recording: Recording | None = None,
    fidelity: Fidelity = Fidelity.FRAME,
) -> Rows:
    """One sequence from a random attitude; the tracker has no attitude at the start.

    recording  kept parts of the frames, and their folder; None: nothing
    fidelity   of the frames: whole, or windows of them; whole where pixels flicker
    Returns  (frames x heads,) structured array, the heads of one time in a row: number of the
             sequence and of the head, time (second), true rate (radian / second), Mode, the
             fields of Outcome for the frame alone, error and stated sigma (radian, axes of the
             camera of the design) of the filter after the frames of all heads, and of the
             alignment of a further head about its axes; NaN where there is none
    Raises    those of `flight` and of the chain's rooms; Refused with the effects that windows
              cannot render, or heads of a unit.
    Accuracy  model: the tracker gets each frame at the end of its exposure. A swing of the mounting
              has one random phase for the whole sequence. The mounting is that of the bench under
              all heads, and moves them together. Windows have the accuracy of `spots_in_windows`;
              their residual charge assumes that the frame before had the same rate.
    """
    streams = core.Streams(seed, number)
    true = flight(case.instrument, sequence, observation.random_attitude(streams), streams)
    rates = gyro_rates(true, sequence.gyro, streams) if sequence.gyro else None
    seen = None if rates is None else exposure_rates(true, rates)
    heads = list(heads_of(case, sequence, true, seed, number, recording, fidelity))
    table = np.empty((len(true.time), len(heads)), FRAMES)
    tracker, asked = TrackerState(), asked_of(case, true, streams)
    # User code states its covariance itself.
    stated = not core.is_code(case.tracker.attitude.method)
    moved = observation.platform_jitter(case) if stated else None
    step, lengths = 0.0, error_lengths(case)
    views = zip(true.time.tolist(), *(head.views for head in heads), strict=True)
    for k, (time, *shown) in enumerate(views):
        before = tracker
        if k:
            step = time - float(true.time[k - 1])
            turned = None if rates is None else rates[k - 1]
            tracker = predict_state(tracker, turned, step, sequence, lengths)
        rate = known_rate(tracker.state, None if seen is None else seen[k])
        second = k > 0 and before.fresh and rates is None
        estimates = [
            head.see(time, view, tracker.predicted, rate, step, alone=second)
            for head, view in zip(heads, shown, strict=True)
        ]
        solved = solved_heads(estimates)
        if not solved:
            tracker = doubted(before, tracker, step, sequence, lengths)
        elif before.fresh and step and sequence.gyro is None:
            first = estimates[solved[0]]
            tracker = from_two_frames(before, first, solved[0], step, sequence, lengths)
        parts = np.array([head.parts for head in heads])
        tracker = update_state(tracker, estimates, sequence, parts, moved)
        for head, estimate in zip(heads, estimates, strict=True):
            table[k, head.number] = (
                number,
                head.number,
                time,
                float(np.linalg.norm(true.turns[k].speed)),
                _mode(tracker),
                *judge(estimate, head.turn * asked[k], head.spots),
                *_known(tracker.predicted, asked[k], head),
            )
    for head in heads:
        head.save()
    return table.ravel()


def fly_sequences(
    case: Case,
    sequence: Sequence,
    sequences: int,
    seed: int,
    executor: Executor,
    progress: Advance | None = None,
    recording: Recording | None = None,
    fidelity: Fidelity = Fidelity.FRAME,
) -> Rows:
    """Many sequences over workers, one after the other in the table, as `run`.

    progress   called with 1 for each sequence that ended
    recording, fidelity  as for `run`
    """
    core.whole(1, 10**6, sequences=sequences)
    tables = []
    fly = partial(run, case, sequence, seed, recording=recording, fidelity=fidelity)
    for table in executor.map(fly, range(sequences)):
        tables.append(table)
        if progress:
            progress(1)
    return np.concatenate(tables)


def asked_of(case: Case, true: SequenceFlight, streams: core.Streams) -> Rotation:
    """The attitudes that a tracker must report in a flight to be free of error.

    As in `observation.reference_attitude`: at late time tags, or as the mean over exposures, in the
    axes of the camera as the tracker believes it mounted.
    """
    when = np.array([case.time_tag_error])
    if case.tracker.reference == "mean":
        exposure = case.instrument.detector.exposure
        when = when + exposure * ((np.arange(MEAN_POINTS) + 0.5) / MEAN_POINTS - 0.5)
    asked = true.attitude
    if when.any():
        turned = [turn.at(when).mean(axis=0) for turn in true.turns]
        asked = Rotation.from_rotvec(np.array(turned)) * asked
    return observation.in_believed_axes(case, asked, streams)


def _mode(tracker: TrackerState) -> Mode:
    if tracker.state and not tracker.missed:
        return Mode.ACQUIRED if tracker.fresh else Mode.TRACKED
    return Mode.SEARCHING if tracker.predicted is None else Mode.COASTED


def _known(state: attitude.State | None, truth: Rotation, head: FlownHead) -> list[float]:
    """Error and stated sigma of the filter, and of the alignment of a further head: 12 numbers."""
    if state is None:
        return [math.nan] * 12
    variance, numbers = np.diag(state.covariance), [math.nan] * 6
    error = (state.icrs_to_camera * truth.inv()).as_rotvec()
    if head.number:
        turned = (state.to_head(head.number) * head.turn.inv()).as_rotvec()
        numbers = [*turned.tolist(), *np.sqrt(variance[state.alignment(head.number)]).tolist()]
    return [*error.tolist(), *np.sqrt(variance[:3]).tolist(), *numbers]
