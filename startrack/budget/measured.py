"""Case -> Budget by trials, with each cause switched off; the standard's indices by sequences."""

from concurrent.futures import Executor
from dataclasses import replace
from enum import Enum
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import observation, response, trial
from startrack.attitude import KnownErrors, Mounting, solve
from startrack.budget import budget
from startrack.budget.analytic import has_hot_pixels
from startrack.budget.budget import BudgetLine, SkySample
from startrack.catalog import open_sky
from startrack.core import Advance, Floats, Frame, Ints, Refused, Spots, Streams, whole
from startrack.design import Case, Instrument
from startrack.detection import Detection, Peaks, calibrated, centroid
from startrack.detector import electron_rate, frame_of, multiplied, shot
from startrack.identification import refit
from startrack.metrics import indices
from startrack.scene import illuminate
from startrack.sequence import Sequence, fly_sequences

SAME = 0.7  # pixel, distance within which two spots are the same star; by hand, below the
# distance of separate spots and above the noise of their centroids
HOT_TOO = "DSNU, hot pixels"
BLOCKS = 8  # of members, for each worker


def measured(
    case: Case,
    members: int,
    seed: int,
    executor: Executor,
    times: int = 1,
    workers: int = 1,
    progress: Advance | None = None,
) -> budget.Budget[budget.SkySample]:
    """Error budget from trials.

        contribution of a cause = error - error without it

    Contributions are vectors. Both errors have the same sky, noise and set of stars, so that the
    effect of one cause does not appear as scatter of another. The contributions of all causes add
    up to the error, except for interactions of causes.

    members   number of random attitudes, each with a device and a calibration of the case
    times     number of frames of each, with different noise
    executor  executor that runs the members
    progress  called with the number of members that were just completed
    Returns   Budget whose lines hold (members, times, 3) errors; a member with an unsolved or false
              frame is left out
    Raises    ValueError if no member is solved in all of its frames.
    Accuracy  statistical: 4 % of an rms across the boresight for 300 members of 1 frame.
    """
    whole(1, 10**7, members=members, times=times)
    budget.refuse_scans(case)
    size = -(-members // (workers * BLOCKS))
    plan = [range(at, min(at + size, members)) for at in range(0, members, size)]
    blocks = []
    for made in executor.map(partial(_members, case, seed, times), plan):
        blocks.append(made)
        if progress:
            progress(len(made[0]))
    table = np.concatenate([block for block, _ in blocks])  # (members, times, 1 + causes, 3)
    stars = np.concatenate([block for _, block in blocks])
    good = np.isfinite(table).all(axis=(1, 2, 3))
    if not good.any():
        raise Refused(f"a budget needs solved trials, got none of {members}")
    lines = [
        budget.BudgetLine(name, term, budget.SkySample(table[good, :, k + 1]))
        for k, (name, term) in enumerate(terms(case))
    ]
    whole_line = budget.BudgetLine("end to end", None, budget.SkySample(table[good, :, 0]))
    available = float(np.isfinite(table).all(axis=(2, 3)).mean())
    return budget.Budget(tuple(lines), whole_line, available, float(stars[good].mean()))


class Content(Enum):
    """Content of a frame."""

    REAL = "everything"
    SHOT = "shot noise as the only noise"
    READ = "the noise of pixels and converter as the only noise"
    NOISE_FREE = "no noise"
    SINGLE = "no noise, and each star in a separate frame, on the boresight"


def terms(case: Case) -> tuple[tuple[str, trial.Term], ...]:
    """The lines of a measured budget."""
    return (*budget.ALWAYS, *((_name(case, cause), cause.term) for cause in budget.causes(case)))


def _name(case: Case, cause: budget.Cause) -> str:
    """Name of a line: trials have one line for DSNU and hot pixels, the analytic budget has two."""
    return HOT_TOO if cause.name == trial.DSNU and has_hot_pixels(case) else cause.name


def contributions(case: Case, attitude: Rotation, streams: Streams) -> tuple[Floats, int]:
    """The error of one trial, and the contribution of each cause.

    A constant cause is switched off in noise-free frames, so that nothing else changes. Each kind
    of noise is added alone to noise-free frames.

    Returns  errors (1 + causes, 3) radian in camera axes: the whole error, then one for each of
             `terms`; NaN if the trial has no correct attitude. And the number of stars
    """
    record = trial.observe(case, attitude, streams)
    rows = np.full((1 + len(terms(case)), 3), np.nan)
    if not record.outcome.solved or record.outcome.false:
        return rows, record.outcome.stars
    again = _Trial(case, attitude, streams, record)
    error, noise_free = again.error(case, Content.REAL), again.error(case, Content.NOISE_FREE)
    ideal = budget.bare(case)
    parts = {
        response.SHOT: again.error(case, Content.SHOT) - noise_free,
        response.READ: again.error(case, Content.READ) - noise_free,
        budget.NEIGHBOURS: again.error(ideal, Content.NOISE_FREE)
        - again.error(ideal, Content.SINGLE),
        response.METHOD: again.error(ideal, Content.SINGLE),
    }
    for cause in budget.causes(case):
        hits = cause.name == trial.HITS
        content, total = (Content.REAL, error) if hits else (Content.NOISE_FREE, noise_free)
        parts[_name(case, cause)] = total - again.error(cause.without(case), content)
    rows[0] = record.outcome.error_x, record.outcome.error_y, record.outcome.error_z
    for k, (name, _) in enumerate(terms(case)):
        rows[k + 1] = parts[name]
    return rows, record.outcome.stars


class _Trial:
    """One trial that is rendered again with other causes, but with the same stars and weights."""

    def __init__(self, case: Case, attitude: Rotation, streams: Streams, record: trial.Record):
        self._case, self._attitude, self._streams = case, attitude, streams
        self._record, self._used = record, _used(case, record)
        self._known = {(_imaging(case), case.tracker.detection, Content.REAL): record.spots}

    def error(self, case: Case, content: Content) -> Floats:
        """(3,) radian: attitude error from a frame of a case, with the tracker's assumptions of
        it."""
        spots = self._spots(case, content)
        matches, (star, direction) = self._record.matches, self._believed(case)
        chosen = replace(matches, direction=direction)
        believes = case.tracker.identification
        stretch = response.knowledge_of(case).stretch
        if stretch is None:
            chosen = replace(chosen, camera=refit(spots, chosen, case.believed_camera, believes))
        else:
            chosen = replace(chosen, camera=case.believed_camera)
            spots, chosen = trial.shrunk(spots, chosen, case.tracker, stretch)
        used = self._used
        kept = replace(chosen, spot=matches.spot[used], star=star[used], direction=direction[used])
        settings = replace(case.tracker.attitude, gate=1e9, sift=False)
        systematic = response.knowledge_of(self._case).systematic[matches.star[used]]
        known = KnownErrors(systematic)
        estimate = solve(spots, kept, settings, believes.focal_tolerance, known)
        assert estimate.icrs_to_camera is not None
        asked = observation.reference_attitude(case, self._attitude, self._streams)
        return (estimate.icrs_to_camera * asked.inv()).as_rotvec()

    def _believed(self, case: Case) -> tuple[Ints, Floats]:
        """The matched stars in the believed catalogue of a case, and their directions there."""
        matches = self._record.matches
        nominal, believed = (open_sky(state.believed_catalog).stars for state in (self._case, case))
        star = matches.star
        if len(believed) != len(nominal) or (believed.identifier != nominal.identifier).any():
            star, _ = believed.find(nominal.identifier[star])
        # Two stars that the catalogue merges have one common direction between them.
        direction = matches.direction + believed.direction[star] - nominal.direction[matches.star]
        return star, direction / np.linalg.norm(direction, axis=1, keepdims=True)

    def _spots(self, case: Case, content: Content) -> Spots:
        """Spots of the same stars, measured in a frame of another case."""
        key = imaging, detection, _ = _imaging(case), case.tracker.detection, content
        if key not in self._known:
            case = replace(case, instrument=imaging)
            self._known[key] = (
                self._single(case)
                if content is Content.SINGLE
                else self._measured(self._frame(case, content), detection)
            )
        return self._known[key]

    def _frame(self, case: Case, content: Content) -> Frame:
        detector, size = case.instrument.detector, response.scale(case)
        electrons = self._electrons(case)
        # If only one kind of noise is present, the ripple stands for the other kinds.
        match content:
            case Content.REAL:
                return frame_of(electrons, detector, self._streams)
            case Content.SHOT:
                caught = multiplied(shot(electrons, self._streams), detector, self._streams)
                return response.noise_free_frame(
                    caught / detector.em_gain, detector, size.noise, size.noise
                )
            case Content.READ:
                frame = response.noise_free_frame(electrons, detector, size.shot, size.noise)
                noise = response.pixel_noise(detector, self._streams) / detector.electrons_per_dn
                return replace(frame, image=np.rint(frame.image + noise).astype(np.float32))
        return response.noise_free_frame(electrons, detector, size.pixel, size.noise)

    def _electrons(self, case: Case) -> Floats:
        path = observation.line_of_sight(case.instrument, self._streams)
        stars = self._record.stars
        return observation.expected_electrons(case, stars, path, self._attitude, self._streams)

    def _single(self, case: Case) -> Spots:
        """Spots of a case without causes: each matched star is measured in a separate cell."""
        matches, stars, camera = self._record.matches, self._record.stars, case.instrument.camera
        matched = open_sky(case.believed_catalog).stars.identifier[matches.star]
        stars = stars[stars.find(matched)[0]]
        light = illuminate(case.scene, stars)
        detector = case.instrument.detector
        rate, _ = electron_rate(light, detector, observation.throughput(case.instrument))
        pixel = camera.project(self._attitude.apply(self._believed(case)[1]))
        old = self._record.spots
        # A star between two pixels may be measured in the window around either of them. Use the
        # window of the other frames.
        nearest = np.rint(np.column_stack([old.x, old.y])[matches.spot])
        side = response.cell_side(case.instrument, case.tracker.detection)
        shape = response.star_images(case.instrument, pixel - nearest, side)
        place, _ = response.measure(case, (rate * detector.exposure)[:, None, None] * shape)
        x, y = old.x.copy(), old.y.copy()
        finite = np.isfinite(place[:, 0])
        x[matches.spot[finite]], y[matches.spot[finite]] = (nearest + place)[finite].T
        return replace(old, x=x, y=y)

    def _measured(self, frame: Frame, detection: Detection) -> Spots:
        """All spots of the record, measured in another frame; a lost spot keeps its old values."""
        old = self._record.spots
        column, row = (np.rint(place).astype(np.int64) for place in (old.x, old.y))
        candidates = Peaks(column, row, old.area)
        plan = observation.detection_plan(self._case, detection)
        new = centroid(frame, calibrated(frame, plan), candidates, plan)
        if not len(new):
            return old
        distance = np.hypot(old.x[:, None] - new.x, old.y[:, None] - new.y)
        nearest = distance.argmin(axis=1)
        same = distance[np.arange(len(old)), nearest] < SAME
        x, y = np.where(same, new.x[nearest], old.x), np.where(same, new.y[nearest], old.y)
        return replace(old, x=x, y=y)


def _imaging(case: Case) -> Instrument:
    """The instrument without mounting and delay, which do not change a frame."""
    return replace(case.instrument, mounting=Mounting(), delay=0.0)


def _used(case: Case, record: trial.Record) -> Ints:
    """Indices of the matches that the estimate used: those with the smallest residuals."""
    matches, estimate = record.matches, record.estimate
    if estimate.stars == len(matches):
        return np.arange(len(matches))
    assert estimate.icrs_to_camera is not None
    seen = matches.camera.project(estimate.icrs_to_camera.apply(matches.direction))
    spots = record.spots
    systematic = response.knowledge_of(case).systematic[matches.star, None, None] * np.eye(2)
    residual = np.column_stack([spots.x, spots.y])[matches.spot] - seen
    inverse = np.linalg.inv(spots.covariance[matches.spot] + systematic)
    square = np.einsum("ni,nij,nj->n", residual, inverse, residual)
    return np.sort(np.argsort(square)[: estimate.stars])


def _members(case: Case, seed: int, times: int, members: range) -> tuple[Floats, Floats]:
    """(members, times, 1 + causes, 3) contributions, and (members, times) numbers of stars."""
    table = np.empty((len(members), times, 1 + len(terms(case)), 3))
    stars = np.empty((len(members), times))
    for i, member in enumerate(members):
        attitude = observation.random_attitude(Streams(seed, member * times))
        for k in range(times):
            streams = Streams(seed, member * times + k)
            table[i, k], stars[i, k] = contributions(case, attitude, streams)
    return table, stars


# A star tracker measures attitude, so its errors are knowledge errors. The corresponding indices of
# the platform's pointing are APE, MPE, RPE and PDE (ECSS-E-ST-60-10C, 3.2).
INDICES: dict[str, str] = {
    "AKE": "absolute knowledge error: the error itself",
    "MKE": "mean knowledge error over each window",
    "RKE": "relative knowledge error: the error less its window's mean",
    "KDE": "knowledge drift error: a window's mean less the previous window's mean",
}


def indices_of(
    case: Case,
    sequence: Sequence,
    members: int,
    seed: int,
    window: float,
    executor: Executor,
    progress: Advance | None = None,
) -> dict[str, BudgetLine[SkySample]]:
    """The indices of the attitudes of single frames, over sequences of random attitudes.

    window   second
    Returns  AKE, MKE, RKE and KDE (see `INDICES`), each a line; its sample has a member for each
             sequence
    Raises   ValueError if the window does not fit twice, or if no sequence was solved in enough
             frames. A frame without an attitude in one sequence is left out of all, so that all
             members have the same windows.
    """
    alone = replace(sequence, heads=())  # frames of the camera of the design alone
    table = fly_sequences(case, alone, members, seed, executor, progress)
    frames = len(table) // members
    error = np.stack([table[f"error_{axis}"] for axis in "xyz"], axis=-1)
    error = error.reshape(members, frames, 3)
    error[table["false"].reshape(members, frames)] = np.nan
    time = table["time"].reshape(members, frames)[0]
    seen = np.all(np.isfinite(error), axis=(0, 2))
    run = _longest(seen)
    if run.stop - run.start < 2:
        raise Refused(f"a sequence needs solved consecutive frames, got {int(seen.sum())} frames")
    step = float(np.diff(time).mean())
    runs = [indices(history, step, window) for history in error[:, run]]
    if not len(runs[0].drift):
        raise Refused(
            f"window must fit twice into the {run.stop - run.start} consecutive frames that are "
            f"solved in all sequences, {step:g} s apart, got {window:g} s"
        )
    return {
        name: BudgetLine(
            name, None, SkySample(np.stack([getattr(member, part) for member in runs]))
        )
        for name, part in zip(INDICES, ("absolute", "mean", "relative", "drift"), strict=True)
    }


def _longest(good: np.ndarray) -> slice:
    """The longest run of True."""
    edge = np.diff(np.concatenate([[0], good.astype(int), [0]]))
    starts, ends = np.flatnonzero(edge > 0), np.flatnonzero(edge < 0)
    if not len(starts):
        return slice(0, 0)
    k = int(np.argmax(ends - starts))
    return slice(int(starts[k]), int(ends[k]))
