"""Attitude and rate -> a frame and the tracker's attitude, one after the other, for a control loop.

A simulator of a spacecraft, or a test bench, requests frames while it runs; the profile of
attitudes is not known before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core, trial
from startrack.core import Floats, Refused, printed
from startrack.design import Case
from startrack.motion import realise_motion
from startrack.sequence.frames import view_of
from startrack.sequence.head import run_on_frame


@printed
@dataclass(frozen=True, eq=False)
class SeenFrame:
    """A frame, and the attitude that the tracker estimates from it.

    number    of the frame, and of the trial with the same noise
    frame     digital numbers (rows, columns)
    estimate  of the attitude icrs_to_camera at the middle of the exposure
    spots     number of spots that the tracker found
    """

    number: int
    frame: core.Frame
    estimate: core.Estimate
    spots: int


class CameraLoop:
    """The camera and the flight software of a design, frame by frame at given attitudes.

    A frame at the rate of the design equals the trial with its number at that attitude (`startrack
    simulate`). It does not depend on earlier frames.

    case  of a matrix detector
    seed  of all random numbers
    Raises    Refused for a detector of lines.
    Accuracy  model: that of a trial in whole frames. Each frame is drawn independently: with
              residual charge, the frame before has the same motion; flickering pixels and jitter
              have no memory from frame to frame. Without a prediction the tracker searches the
              whole sky in each frame.
    """

    def __init__(self, case: Case, seed: int = 1) -> None:
        if case.instrument.detector.scan:
            raise Refused("instrument.detector.scan must be left out: lines take no single frames")
        self.case, self.seed, self._next = case, seed, 0

    @property
    def period(self) -> float:
        """Second from frame to frame, at the update rate of the design."""
        return 1 / self.case.instrument.detector.update_rate

    def see(
        self, icrs_to_camera: Rotation, rate: Floats | None = None, number: int | None = None
    ) -> SeenFrame:
        """The next frame.

        icrs_to_camera  true attitude at the middle of the exposure
        rate    (3,) radian / second of the camera about its own axes, constant in the exposure;
                the tracker knows it. None: the rate of the design
        number  of the frame; None: the one after the last
        Raises  ValueError as `startrack.trial.observe`; Refused for a rate that is not finite.
        """
        number = self._next if number is None else number
        streams = core.Streams(self.seed, number)
        if rate is None:
            record = trial.observe(self.case, icrs_to_camera, streams)
            seen = SeenFrame(number, record.frame, record.estimate, len(record.spots))
        else:
            seen = self._turning(icrs_to_camera, np.asarray(rate, float), number, streams)
        self._next = number + 1
        return seen

    def _turning(
        self, icrs_to_camera: Rotation, rate: Floats, number: int, streams: core.Streams
    ) -> SeenFrame:
        """A frame at a rate that is not the design's."""
        if rate.shape != (3,) or not np.isfinite(rate).all():
            raise Refused(f"rate must be three finite numbers, got {rate.tolist()}")
        case, instrument = self.case, self.case.instrument
        motion = replace(instrument.motion, rate_x=0.0, rate_y=0.0, rate_z=0.0)
        turn = realise_motion(motion, instrument.detector.exposure, streams)
        frame, _, _ = trial.frame_at(case, icrs_to_camera, streams, replace(turn, rate=rate))
        spots, _, estimate, _ = run_on_frame(
            case,
            view_of(case, frame),
            case.believed_camera,
            None,
            rate,
            trial.Images(),
            alone=False,
        )
        return SeenFrame(number, frame, estimate, len(spots))
