"""Case and sequence -> a table with a row for each frame."""

from __future__ import annotations

import collections.abc
import math
import typing
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import attitude, core, observation, response, trial
from startrack.attitude import start
from startrack.catalog import open_sky
from startrack.core import Advance, Floats, Refused, Rows
from startrack.design import Case, Fidelity, replaced_all
from startrack.detection import detect
from startrack.detector import Exposure, expected, flickering, frame_of
from startrack.identification import identify, track
from startrack.io import FrameFiles, save_arrays
from startrack.metrics import Outcome, judge
from startrack.motion import trace
from startrack.scene import date_of
from startrack.sequence.flight import SequenceFlight, exposure_rates, flight, gyro_rates
from startrack.sequence.parameters import Sequence
from startrack.trial import Images

GATE = 30.7  # chi-square of 3 degrees of freedom, exceeded once in a million by noise alone
NUMBER_OF_FRAMES = 2**32  # distance between the trial numbers of two sequences
NUMBER_OF_HEAD = 2**21  # between the numbers of the sequences of two heads
AXES = "xyz"
Estimates = collections.abc.Sequence[core.Estimate]
# Of a pixel, that stars move while their errors over it change; chosen by hand.
PIXEL_LENGTH = 0.5
FASTEST = 10.0  # sigma of the rate at the start, that two frames may show
MEAN_POINTS = 64  # of an exposure, whose mean attitude is asked for
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


@dataclass(frozen=True, eq=False)
class TrackerState:
    """State of the tracker between two frames.

    state   of the filter, None without any attitude yet; after a loss, too, without a gyroscope
    lasting (heads, 3, 3, 3) radian^2, what of the last attitude's error of each head lasts, as
            `lasting_parts`
    missed  frames without an attitude that was used, since the last one
    fresh   whether the last frame started the filter, or ended a loss
    lost    whether there were too many of these for the attitude to be predicted; the filter of a
            gyroscope goes on, so that its bias and its axes stay known
    """

    state: attitude.State | None = None
    lasting: Floats = field(default_factory=lambda: np.zeros((1, 3, 3, 3)))
    missed: int = 0
    fresh: bool = False
    lost: bool = False

    @property
    def predicted(self) -> attitude.State | None:
        """The state about which the tracker looks for stars; None where it knows no attitude."""
        return None if self.lost else self.state


def predict_state(
    tracker: TrackerState, shown: Floats | None, step: float, sequence: Sequence, lengths: Floats
) -> TrackerState:
    """Predict the state at the next frame.

    Without a gyroscope the filter assumes one that reads zero: its bias is then minus the rate of
    the camera, and its random walk the angular acceleration.

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
        # A turn about x moves stars along y, one about z those off the middle along both.
        along = lengths[1] / 2 * z
        moved = np.array([y + along, x + along, np.hypot(x, y) + z / 2])
        keep.append(np.exp(-moved / lengths[[0, 0, 1]]))
    errors = attitude.LastingErrors(tracker.lasting.reshape(-1, 3, 3), np.concatenate(keep))
    return replace(
        tracker,
        state=attitude.predict(tracker.state, rate, step, attitude.Gyroscope(*walks), errors),
    )


def error_lengths(case: Case) -> Floats:
    """Radian (2,) that a camera turns while errors over pixels, and over the field, change.

    Half a pixel, and half of the field's smaller side.
    """
    camera = case.believed_camera
    half = math.atan(min(camera.columns, camera.rows) / 2 / camera.focal_length_px)
    return np.array([PIXEL_LENGTH / camera.focal_length_px, half])


def lasting_parts(
    case: Case, spots: core.Spots, matches: core.Matches, estimate: core.Estimate
) -> Floats:
    """What of a measured attitude's covariance lasts (3, 3, 3): over pixels in x, in y, and over
    the field.

    Of least squares with the weights w of stars, of whose variance a fraction f lasts,

        P [sum w f (J_x J_x' + J_y J_y')] P,   P^-1 = sum w (J_x J_x' + J_y J_y')

    with the slopes J_x and J_y of a star's place by turns about the axes, of which an error in x
    has the first and one in y the second; in proportion to what the estimate states of itself.

    Accuracy  model: jitter is new in each frame; what a calibration leaves is of the field.
    """
    assert estimate.icrs_to_camera is not None
    noise = np.trace(spots.covariance[matches.spot], axis1=1, axis2=2) / 2
    systematic, pixel, hot = (
        part(case)[matches.star]
        for part in (response.systematic_variance, response.pixel_variance, response.hot_variance)
    )
    weight = 1 / (noise + systematic)
    u, v, w = estimate.icrs_to_camera.apply(matches.direction).T
    u, v = u / w, v / w
    in_x = np.stack([-u * v, 1 + u**2, -v], axis=1)
    in_y = np.stack([-1 - v**2, u * v, u], axis=1)

    def summed(weight: Floats, *slopes: Floats) -> Floats:
        return np.asarray(sum((weight[:, None] * slope).T @ slope for slope in slopes))

    # User code states its covariance itself.
    shared = None if core.is_code(case.tracker.attitude.method) else response.shared_errors(case)
    still = estimate.covariance - np.diag(shared.turn) if shared else estimate.covariance
    # Triangles of P^-1 and of the inverse of what is stated: P is stretched to it.
    fit = np.linalg.cholesky(summed(weight, in_x, in_y))
    stretch = np.linalg.solve(np.linalg.cholesky(np.linalg.inv(still)).T, np.linalg.inv(fit))
    share = weight / (noise + systematic + hot)
    of_pixel, of_field = share * (pixel + hot), share * np.maximum(systematic - pixel, 0.0)
    sums = summed(of_pixel, in_x), summed(of_pixel, in_y), summed(of_field, in_x, in_y)
    return np.array([stretch @ part @ stretch.T for part in sums])


def doubted(
    before: TrackerState, predicted: TrackerState, step: float, sequence: Sequence, lengths: Floats
) -> TrackerState:
    """The prediction of a frame that has no attitude, though the frame before it had one.

    A manoeuvre that the tracker was not told of may have begun: without a gyroscope, its rate may
    have changed by `initial_rate_sigma` at some time since the frame before.

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

    That of its gyroscope without its estimated errors, or of its filter; zero where it has neither.

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

    An attitude that contradicts the prediction is left out where one of another head agrees with
    it. Where none agrees, the first restarts the filter, because stars were measured and the
    prediction was not; but by a gyroscope it was, and then the frames count as missed.

    estimates  of the frames of one time, one for each head
    parts      (heads, 3, 3, 3) of the covariance of each attitude, as `lasting_parts`
    moved      (3,) radian^2 about the axes of a camera, within each covariance: the motion of the
               platform in an exposure, one for all heads; None: none
    """
    own = np.zeros((3, 3)) if moved is None else np.diag(moved)
    state, solved = tracker.state, _solved(estimates)
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
        # Until the others have measured an attitude: their errors are alike.
        fresh, lasting = True, np.array([parts[head]] * len(estimates))
        agreeing = [k for k in others if not _contradicts(state, estimates[k], k)]
        # Of an attitude that nothing was known of, what is common adds to what is independent.
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
    """The prediction of a frame by the rate that its attitude and that of the frame before give.

    A filter without gyroscope that has seen one frame knows its rate within `initial_rate_sigma`
    about zero. The second attitude says it, whatever it is: the prediction is made again about it,
    and the update weighs both.

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


def _solved(estimates: Estimates) -> list[int]:
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


class Mode(IntEnum):
    """How the tracker obtained its attitude after a frame."""

    SEARCHING = 0  # no prediction, not solved
    ACQUIRED = 1  # solved without a prediction, or against it
    TRACKED = 2  # solved, as predicted, by one head at least
    COASTED = 3  # not solved, or against what a gyroscope predicts; the prediction alone


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


@dataclass(frozen=True)
class Recording:
    """Files that keep what a tracker saw in sequences.

    folder  of sequence-0001.csv and so on, and of the frames
    format  of the frames, one of FORMATS of `startrack.io`, with their times and true attitudes;
            None: they are not kept
    stars   whether the images of each matched star over time are kept, in sequence-0001-stars.npz:
            time, number (less the offset), col0 and row0 of its first pixel, and the place x and
            y as measured, each behind gaia or hip and the star's number, as `compare-flight`
            reads them
    """

    folder: Path
    format: str | None
    stars: bool = False


def run(
    case: Case,
    sequence: Sequence,
    seed: int,
    number: int,
    recording: Recording | None = None,
    fidelity: Fidelity = Fidelity.FRAME,
) -> Rows:
    """One sequence from a random attitude, by a tracker without an attitude at its start.

    recording  what is kept of the frames, and where; None: nothing
    fidelity   of the frames: whole, or windows of them; whole where pixels flicker
    Returns  (frames x heads,) structured array, the heads of one time in a row: number of the
             sequence and of the head, time (second), true rate (radian / second), Mode, the
             fields of Outcome for the frame alone, error and stated sigma (radian, axes of the
             camera of the design) of the filter after the frames of all heads, and of the
             alignment of a further head about its axes; NaN where there is none
    Raises    those of `flight` and of the chain's rooms; Refused that names what windows cannot
              do, or heads of a unit.
    Accuracy  model: the tracker gets each frame at the end of its exposure. A swing of the
              mounting stays where it is for the whole sequence, at a random phase; the mounting
              is that of the bench which all heads stand on, and moves them together. Windows have
              the accuracy of `spots_in_windows`, and a residual charge as if the camera had turned
              before as it turns now.
    """
    streams = core.Streams(seed, number)
    true = flight(case.instrument, sequence, observation.random_attitude(streams), streams)
    rates = gyro_rates(true, sequence.gyro, streams) if sequence.gyro else None
    seen = None if rates is None else exposure_rates(true, rates)
    heads = list(_heads(case, sequence, true, seed, number, recording, fidelity))
    table = np.empty((len(true.time), len(heads)), FRAMES)
    tracker, asked = TrackerState(), asked_of(case, true, streams)
    # Code of a user's own states its covariance itself.
    stated = not core.is_code(case.tracker.attitude.method)
    moved = response.platform_jitter(case) if stated else None
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
        solved = _solved(estimates)
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


class _Head:
    """One head in a sequence: its frames, and what it keeps from one to the next.

    number   0: the camera of the design
    turn     true rotation to its axes from those of the camera of the design
    views    of its frames, one after the other
    parts    (3, 3, 3) radian^2, of its last attitude's covariance, as `lasting_parts`
    spots    number of them in its last frame
    """

    def __init__(
        self,
        case: Case,
        sequence: Sequence,
        head: int,
        turn: Rotation,
        views: Iterator[_View],
        kept: Path | None,
    ) -> None:
        self.number, self.turn, self.parts, self.spots = head, turn, np.zeros((3, 3, 3)), 0
        self.views, self._case, self._filter = views, case, sequence.camera
        self._camera, self._images, self._since = case.believed_camera, Images(), 0.0
        self._learnt = None
        if self._filter:
            self._learnt = attitude.first_camera(self._camera, self._filter)
        self._believed = sequence.heads[head - 1].to_head if head else turn
        self._kept, self._stars = kept, _StarImages(case)

    def see(
        self,
        time: float,
        view: _View,
        state: attitude.State | None,
        rate: Floats,
        step: float,
        alone: bool,
    ) -> core.Estimate:
        """The attitude of the next frame.

        time   second, of its middle
        state  the predicted state; None without one
        rate   (3,) radian / second, as `known_rate` gives it
        step   second, since the frame before
        alone  as for `_see`
        """
        predicted = state.seen_by(self.number) if state else None
        to_head = state.to_head(self.number) if state else self._believed
        spots, matches, estimate, self._images = _see(
            self._case, view, self._camera, predicted, to_head.apply(rate), self._images, alone
        )
        self._since, self.spots = self._since + step, len(spots)
        if estimate.status is core.Status.SOLVED:
            self._camera = matches.camera
            self.parts = lasting_parts(self._case, spots, matches, estimate)
            if self._learnt and self._filter:
                estimate = self._learn(estimate, spots, matches)
        if self._kept and view.frame:
            self._stars.add(time, view.frame, spots, matches, self._images)
        return estimate

    def _learn(
        self, estimate: core.Estimate, spots: core.Spots, matches: core.Matches
    ) -> core.Estimate:
        """Calibrate the camera with a frame; its attitude with the doubt of the camera before."""
        assert self._learnt
        assert self._filter
        learnt = self._learnt.later(self._filter, self._since)
        doubt = attitude.attitude_doubt(learnt, self._filter, spots, matches)
        self.parts = self.parts + np.stack([np.zeros((3, 3)), np.zeros((3, 3)), doubt])
        self._learnt = attitude.after_frame(learnt, self._filter, spots, matches)
        self._camera, self._since = self._learnt.camera, 0.0
        return replace(estimate, covariance=estimate.covariance + doubt)

    def save(self) -> None:
        """Write the images of its stars, where they are kept."""
        if self._kept:
            self._stars.save(self._kept)


def _heads(
    case: Case,
    sequence: Sequence,
    true: SequenceFlight,
    seed: int,
    number: int,
    recording: Recording | None,
    fidelity: Fidelity,
) -> Iterator[_Head]:
    """The camera of the design, and the further heads, whose alignments are drawn."""
    # As trials in windows, whose pixels that flicker need the whole frame.
    whole_alone = fidelity is Fidelity.WINDOW and case.instrument.detector.flickers
    if sequence.heads and case.design is not None:
        raise Refused("heads must be left out of a sequence of a unit, which is one camera")
    motion = case.instrument.motion
    if sequence.heads and motion.jitters and motion.jitter_of != "platform":
        raise Refused(
            "instrument.motion.jitter_of must be platform in a sequence of several heads, which "
            f"one bench moves together, got {motion.jitter_of}"
        )
    error = core.Streams(seed, number)("alignment of heads").standard_normal
    turns = [Rotation.identity()]
    for head in sequence.heads:
        turns.append(Rotation.from_rotvec(head.alignment_sigma * error(3)) * head.to_head)
    for k, turn in enumerate(turns):
        device, flown = (_other_device(case, k), true.seen_from(turn)) if k else (case, true)
        name, own = _name(number, k), number + k * NUMBER_OF_HEAD
        views = (
            _whole_frames(device, flown, seed, own, recording, name)
            if fidelity is Fidelity.FRAME or whole_alone
            else _windows(device, flown, seed, own, recording, fidelity)
        )
        kept = recording.folder / f"{name}-stars.npz" if recording and recording.stars else None
        yield _Head(device, sequence, k, turn, views, kept)


def _other_device(case: Case, number: int) -> Case:
    """The case with other maps of its detector, and another residual of its lens."""
    seeds = {"instrument.detector.device_seed": case.instrument.detector.device_seed}
    residual = case.instrument.residual
    if residual and residual.seed:
        seeds["instrument.residual.seed"] = residual.seed
    return replaced_all(case, {name: seed + number for name, seed in seeds.items()})


def _name(number: int, head: int) -> str:
    return f"sequence-{number + 1:04d}" + (f"-head-{head + 1}" if head else "")


class _StarImages:
    """Images of matched stars, and where they were."""

    def __init__(self, case: Case) -> None:
        self._half = case.tracker.box.size // 2
        self._offset = case.instrument.detector.offset
        self._identifier = open_sky(case.believed_catalog).stars.identifier
        self._rows = defaultdict[int, list[tuple[Any, ...]]](list)

    def add(
        self,
        time: float,
        frame: core.Frame,
        spots: core.Spots,
        matches: core.Matches,
        images: Images,
    ) -> None:
        """Images are where the tracker has them, or about the pixel nearest to the spot."""
        rows, columns = frame.image.shape
        for spot, star in zip(matches.spot.tolist(), matches.star.tolist(), strict=True):
            x, y = float(spots.x[spot]), float(spots.y[spot])
            middle = images.get(star, (math.floor(x) + 1, math.floor(y) + 1))
            left, top = (at - self._half for at in middle)
            side = 2 * self._half
            if 0 <= left <= columns - side and 0 <= top <= rows - side:
                pixel = frame.image[top : top + side, left : left + side]
                number = np.asarray(pixel, np.float32) - self._offset
                self._rows[star].append((time, number, left, top, x, y))

    def save(self, path: Path) -> None:
        names = "time", "number", "col0", "row0", "x", "y"
        tables = {}
        for star, rows in self._rows.items():
            number = int(self._identifier[star])
            name = f"gaia{number}" if number > 0 else f"hip{-number}"
            tables[name] = dict(zip(names, zip(*rows, strict=True), strict=True))
        save_arrays(path, tables)


def asked_of(case: Case, true: SequenceFlight, streams: core.Streams) -> Rotation:
    """The attitudes that a tracker must report in a flight, so that the spacecraft's are correct.

    As `observation.reference_attitude`: at late time tags, as the mean over exposures, in the axes
    of a mounting that the tracker does not know.
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


class _View(NamedTuple):
    """What a tracker may look at: spots (of what smear it believes), and a whole frame or none."""

    spots: Callable[[tuple[float, float]], core.Spots]
    frame: core.Frame | None


def _whole_frames(
    case: Case, true: SequenceFlight, seed: int, number: int, recording: Recording | None, name: str
) -> Iterator[_View]:
    for frame in _kept(case, true, seed, number, recording, name):
        yield _View(partial(_in_frame, case, observation.as_believed(case, frame)), frame)


def _in_frame(case: Case, frame: core.Frame, smear: tuple[float, float]) -> core.Spots:
    return detect(frame, observation.detection_plan(case, smear=smear))


def _windows(
    case: Case,
    true: SequenceFlight,
    seed: int,
    number: int,
    recording: Recording | None,
    fidelity: Fidelity,
) -> Iterator[_View]:
    """Views of windows of each frame, whose numbers are those of the whole frames."""
    needs = {
        "fidelity must be frame or window in a sequence": fidelity is not Fidelity.WINDOW,
        "fidelity must be frame where frames or images of stars are kept": recording is not None,
        "fidelity must be frame in a sequence with search boxes (tracker.acquisition)": trial.boxed(
            case
        ),
    }
    for text, needed in needs.items():
        if needed:
            raise Refused(f"{text}, got {fidelity}")
    for k, turn in enumerate(true.turns):
        noise = core.Streams(seed, number * NUMBER_OF_FRAMES + k)
        yield _View(partial(trial.spots_in_windows, case, true.attitude[k], noise, turn), None)


def _sky(seed: int, number: int) -> core.Streams:
    """What the sky of a sequence is drawn from, its date too: the same for all of its heads."""
    return core.Streams(seed, number % NUMBER_OF_HEAD)


def _kept(
    case: Case, true: SequenceFlight, seed: int, number: int, recording: Recording | None, name: str
) -> Iterator[core.Frame]:
    """The frames of a flight, each written before it is used where they are kept."""
    if recording is None or recording.format is None:
        yield from (frame for frame, _ in _frames(case, true, seed, number))
        return
    begin = date_of(case.scene, case.catalog.year, _sky(seed, number))
    files = FrameFiles(recording.folder, name, recording.format, begin)
    camera = None if case.instrument.detector.scan else case.instrument.camera
    try:
        for k, (frame, stars) in enumerate(_frames(case, true, seed, number)):
            history = f"startrack sequence, seed {seed}, {name}, frame {k + 1}"
            files.add(frame, float(true.time[k]), true.attitude[k], camera, stars, history)
            yield frame
        files.close()
    finally:
        files.drop()


def _frames(
    case: Case, true: SequenceFlight, seed: int, number: int
) -> Iterator[tuple[core.Frame, core.Stars]]:
    """The frames of a flight, each with other noise, and residual charge of the one before."""
    instrument, camera = case.instrument, case.instrument.camera
    detector, before = instrument.detector, None
    state = flickering(detector, core.Streams(seed, number))
    for k, turn in enumerate(true.turns):
        stars = observation.stars_in_field(open_sky(case.catalog), true.attitude[k], camera)
        path = trace(turn, detector.exposure, 1 / camera.focal_length_px, camera.half_diagonal)
        light = observation.light_of(case, stars, true.attitude[k], _sky(seed, number))
        exposure = Exposure(
            light,
            observation.images_of(instrument),
            path,
            true.attitude[k],
            camera,
            detector,
            observation.throughput(instrument),
            turn.over,
            before,
        )
        electrons = expected(exposure)
        before = electrons if detector.lag else None
        if state and k:
            state.later(float(true.time[k] - true.time[k - 1]))
        noise = core.Streams(seed, number * NUMBER_OF_FRAMES + k)
        yield frame_of(electrons, detector, noise, state=state), stars


def _see(
    case: Case,
    view: _View,
    camera: core.Camera,
    predicted: tuple[Rotation, Floats] | None,
    rate: Floats,
    images: Images,
    alone: bool,
) -> tuple[core.Spots, core.Matches, core.Estimate, Images]:
    """What the flight software does with a frame, with a prediction or without.

    predicted  attitude, and its covariance (3, 3) radian^2; None: no prediction
    rate       (3,) radian / second, that is believed
    images  of its stars, where the frame before left them; the last of the result: this one
    alone   whether the rate of a prediction is not known, so that a tracker which takes its rate
            from the images does so again, and searches the whole sky
    """
    tracker, frame = case.tracker, view.frame
    if alone and tracker.rate == "images":
        predicted = None
    if predicted is None and tracker.rate == "images" and frame:
        x, y = observation.seen_smear(case, frame)
    else:
        smears = observation.smear_of(case, rate[0], rate[1])
        x, y = (observation.SMEAR_STEP * round(smear / observation.SMEAR_STEP) for smear in smears)
    if trial.boxed(case) and predicted is not None and frame:
        plan = observation.detection_plan(case, smear=(x, y))
        spots, matches, images = trial.follow_boxes(case, frame, camera, predicted[0], images, plan)
        spots = observation.at_one_time(spots, case.believed_row_delay, rate, camera)
        estimate = trial.estimate_of(case, trial.agreeing(tracker), spots, matches)
        return spots, matches, estimate, images
    stars = open_sky(case.believed_catalog).stars
    spots = observation.at_one_time(view.spots((x, y)), case.believed_row_delay, rate, camera)
    rooms = spots, camera, stars, trial.pattern_indexes(case.believed_catalog)(case.believed_camera)
    if predicted is None:
        matches = identify(*rooms, tracker.identification)
    else:
        matches = track(*rooms, *predicted, tracker.identification)
    return spots, matches, trial.estimate_of(case, tracker, spots, matches), Images()


def _mode(tracker: TrackerState) -> Mode:
    if tracker.state and not tracker.missed:
        return Mode.ACQUIRED if tracker.fresh else Mode.TRACKED
    return Mode.SEARCHING if tracker.predicted is None else Mode.COASTED


def _known(state: attitude.State | None, truth: Rotation, head: _Head) -> list[float]:
    """Error and stated sigma of the filter, and of the alignment of a further head: 12 numbers."""
    if state is None:
        return [math.nan] * 12
    variance, numbers = np.diag(state.covariance), [math.nan] * 6
    error = (state.icrs_to_camera * truth.inv()).as_rotvec()
    if head.number:
        turned = (state.to_head(head.number) * head.turn.inv()).as_rotvec()
        numbers = [*turned.tolist(), *np.sqrt(variance[state.alignment(head.number)]).tolist()]
    return [*error.tolist(), *np.sqrt(variance[:3]).tolist(), *numbers]
