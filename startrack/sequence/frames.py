"""True flight of a head -> its frames, whole or in windows, as the flight software gets them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

from startrack import core, observation, trial
from startrack.catalog import open_sky
from startrack.core import Refused
from startrack.design import Case, Fidelity
from startrack.detection import detect
from startrack.detector import Exposure, expected, flickering, frame_of
from startrack.io import FrameFiles
from startrack.motion import trace
from startrack.scene import date_of
from startrack.sequence.flight import SequenceFlight
from startrack.sequence.recording import Recording

NUMBER_OF_FRAMES = 2**32  # difference between the trial numbers of two sequences
NUMBER_OF_HEAD = 2**21  # difference between the numbers of the sequences of two heads


class FrameView(NamedTuple):
    """Data that a tracker may read: spots (for the smear that it believes), and a whole frame or
    none.
    """

    spots: Callable[[tuple[float, float]], core.Spots]
    frame: core.Frame | None


def whole_frames(
    case: Case, true: SequenceFlight, seed: int, number: int, recording: Recording | None, name: str
) -> Iterator[FrameView]:
    """Views of whole frames; if a recording keeps them, each is written before it is used."""
    for frame in _kept(case, true, seed, number, recording, name):
        yield view_of(case, frame)


def view_of(case: Case, frame: core.Frame) -> FrameView:
    """View of a whole frame."""
    return FrameView(partial(_in_frame, case, observation.as_believed(case, frame)), frame)


def _in_frame(case: Case, frame: core.Frame, smear: tuple[float, float]) -> core.Spots:
    return detect(frame, observation.detection_plan(case, smear=smear))


def windows(
    case: Case,
    true: SequenceFlight,
    seed: int,
    number: int,
    recording: Recording | None,
    fidelity: Fidelity,
) -> Iterator[FrameView]:
    """Views of windows of each frame; their numbers equal those of the whole frames."""
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
        yield FrameView(partial(trial.spots_in_windows, case, true.attitude[k], noise, turn), None)


def _sky(seed: int, number: int) -> core.Streams:
    """Random stream of a sequence's sky and date, the same for all of its heads."""
    return core.Streams(seed, number % NUMBER_OF_HEAD)


def _kept(
    case: Case, true: SequenceFlight, seed: int, number: int, recording: Recording | None, name: str
) -> Iterator[core.Frame]:
    """The frames of a flight; if they are kept, each is written before it is used."""
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
    """The frames of a flight, each with new noise and the residual charge of the frame before."""
    instrument, camera = case.instrument, case.instrument.camera
    detector, before = instrument.detector, None
    state = flickering(detector, core.Streams(seed, number))
    for k, turn in enumerate(true.turns):
        stars = observation.stars_in_field(open_sky(case.catalog), true.attitude[k], camera)
        path = trace(turn, detector.exposure, 1 / camera.focal_length_px, camera.half_diagonal)
        light = observation.light_of(case, stars, true.attitude[k], _sky(seed, number))
        exposure = Exposure(
            light=light,
            psf=observation.images_of(instrument),
            line_of_sight=path,
            icrs_to_camera=true.attitude[k],
            camera=camera,
            detector=detector,
            throughput=observation.throughput(instrument),
            motion_function=turn.over,
            residual_charge=before,
            of_colours=observation.throughput_of_colours(instrument),
        )
        electrons = expected(exposure)
        before = electrons if detector.lag else None
        if state and k:
            state.later(float(true.time[k] - true.time[k - 1]))
        noise = core.Streams(seed, number * NUMBER_OF_FRAMES + k)
        yield frame_of(electrons, detector, noise, state=state), stars
