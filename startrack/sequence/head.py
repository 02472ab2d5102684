"""One head in a sequence: the attitude of each of its frames, and its memory between frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import attitude, core, observation, response, trial
from startrack.catalog import open_sky
from startrack.core import Floats, Refused
from startrack.design import Case, Fidelity, replaced_all
from startrack.identification import identify, track
from startrack.sequence.flight import SequenceFlight
from startrack.sequence.frames import NUMBER_OF_HEAD, FrameView, whole_frames, windows
from startrack.sequence.lasting import lasting_parts
from startrack.sequence.parameters import Sequence
from startrack.sequence.recording import Recording, StarRecording
from startrack.trial import Images


class FlownHead:
    """One head in a sequence: its frames, and its memory from frame to frame.

    number   0: the camera of the design
    turn     true rotation to its axes from those of the camera of the design
    views    of its frames, one after the other
    parts    (3, 3, 3) radian^2, lasting parts of its last attitude's covariance, `lasting_parts`
    spots    number of spots in its last frame
    """

    def __init__(
        self,
        case: Case,
        sequence: Sequence,
        head: int,
        turn: Rotation,
        views: Iterator[FrameView],
        kept: Path | None,
    ) -> None:
        self.number, self.turn, self.parts, self.spots = head, turn, np.zeros((3, 3, 3)), 0
        self.views, self._case, self._filter = views, case, sequence.camera
        self._camera, self._images, self._since = case.believed_camera, Images(), 0.0
        self._learnt = None
        if self._filter:
            self._learnt = attitude.first_camera(self._camera, self._filter)
        self._believed = sequence.heads[head - 1].to_head if head else turn
        self._kept, self._stars = kept, StarRecording(case)

    def see(
        self,
        time: float,
        view: FrameView,
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
        alone  as for `run_on_frame`
        """
        predicted = state.seen_by(self.number) if state else None
        to_head = state.to_head(self.number) if state else self._believed
        spots, matches, estimate, self._images = run_on_frame(
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
        """Calibrate the camera with a frame; add the camera's earlier uncertainty to the
        attitude."""
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


def run_on_frame(
    case: Case,
    view: FrameView,
    camera: core.Camera,
    predicted: tuple[Rotation, Floats] | None,
    rate: Floats,
    images: Images,
    alone: bool,
) -> tuple[core.Spots, core.Matches, core.Estimate, Images]:
    """Run the flight software on a frame, with or without a prediction.

    predicted  attitude, and its covariance (3, 3) radian^2; None: no prediction
    rate       (3,) radian / second, that is believed
    images  images of its stars from the frame before; the last result is those of this frame
    alone   whether the rate of a prediction is unknown; then a tracker that measures its rate from
            the images does so again and searches the whole sky
    """
    tracker, frame, knowledge = case.tracker, view.frame, response.knowledge_of(case)
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
        estimate = trial.solve_matches(spots, matches, trial.agreeing(tracker), knowledge)
        return spots, matches, estimate, images
    stars = open_sky(case.believed_catalog).stars
    spots = observation.at_one_time(view.spots((x, y)), case.believed_row_delay, rate, camera)
    rooms = spots, camera, stars, trial.pattern_indexes(case.believed_catalog)(case.believed_camera)
    if predicted is None:
        matches = identify(*rooms, tracker.identification)
    else:
        matches = track(*rooms, *predicted, tracker.identification)
    return spots, matches, trial.solve_matches(spots, matches, tracker, knowledge), Images()


def heads_of(
    case: Case,
    sequence: Sequence,
    true: SequenceFlight,
    seed: int,
    number: int,
    recording: Recording | None,
    fidelity: Fidelity,
) -> Iterator[FlownHead]:
    """The camera of the design, and the further heads with drawn alignments."""
    # As for trials in windows: flickering pixels need the whole frame.
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
            whole_frames(device, flown, seed, own, recording, name)
            if fidelity is Fidelity.FRAME or whole_alone
            else windows(device, flown, seed, own, recording, fidelity)
        )
        kept = recording.folder / f"{name}-stars.npz" if recording and recording.stars else None
        yield FlownHead(device, sequence, k, turn, views, kept)


def _other_device(case: Case, number: int) -> Case:
    """The case with other maps of its detector, and another residual of its lens."""
    seeds = {"instrument.detector.device_seed": case.instrument.detector.device_seed}
    residual = case.instrument.residual
    if residual and residual.seed:
        seeds["instrument.residual.seed"] = residual.seed
    return replaced_all(case, {name: seed + number for name, seed in seeds.items()})


def _name(number: int, head: int) -> str:
    return f"sequence-{number + 1:04d}" + (f"-head-{head + 1}" if head else "")
