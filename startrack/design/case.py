"""Case: what is true and what the tracker believes, kept apart; how faithful a trial is to it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import Annotated

from startrack.attitude import Mounting, SolverSettings
from startrack.catalog import Selection
from startrack.core import Camera, Unit, finite
from startrack.design.epoch import believed_from, seen_from
from startrack.detection import Detection
from startrack.detector import Detector
from startrack.identification import Identification
from startrack.motion import Motion
from startrack.optics import Baffle, Optics
from startrack.scene import Scene


class Fidelity(StrEnum):
    """How much of a trial is computed; each is a cheaper approximation of the one before.

    frame       the whole image is rendered and searched
    window      only the pixels that the detection could look at: around stars, and where noise
                alone passes the threshold
    spots       spots are drawn from the centroids' bias and covariance, without an image, and are
                identified and solved as those of a frame
    covariance  spots are drawn as in `spots`; identification is assumed to be perfect
    """

    FRAME = "frame"
    WINDOW = "window"
    SPOTS = "spots"
    COVARIANCE = "covariance"


@dataclass(frozen=True)
class Instrument:
    """The truth that makes the frame, and that its attitude is judged by.

    mounting  how the camera sits on the spacecraft
    delay     second, by which the time stamp of a frame lies after the middle of its exposure
    baffle    what it lets through of Sun, Moon and Earth; None: nothing
    """

    optics: Optics
    detector: Detector
    motion: Motion = field(default_factory=Motion)
    mounting: Mounting = field(default_factory=Mounting)
    delay: Annotated[float, Unit("s", "ms")] = 0.0
    baffle: Baffle | None = None

    def __post_init__(self) -> None:
        finite(delay=self.delay)

    @cached_property
    def camera(self) -> Camera:
        """Where directions truly fall."""
        optics = self.optics
        shift_x, shift_y = self.detector.shift
        return Camera(
            self.detector.columns,
            self.detector.rows,
            optics.focal_length / self.detector.pitch,
            optics.principal_x + shift_x,
            optics.principal_y + shift_y,
            optics.k1,
            optics.k2,
            optics.p1,
            optics.p2,
            optics.k3,
        )


@dataclass(frozen=True)
class Tracker:
    """What the flight software believes and how it works.

    camera    its calibration; None for a perfect one, which follows the instrument's design
    catalog   its cut of the star catalogue, None for the one that the sky is made of
    mounting  mounting that it assumes, None for the true one without its swing
    delay     second that it takes off its time stamps, None for all of the delay there is
    motion    how it believes the camera to turn, None for as it does, jitter apart; where lines
              scan, each spot has its own time
    """

    detection: Detection = field(default_factory=Detection)
    identification: Identification = field(default_factory=Identification)
    attitude: SolverSettings = field(default_factory=SolverSettings)
    camera: Camera | None = None
    catalog: Selection | None = None
    mounting: Mounting | None = None
    delay: Annotated[float | None, Unit("s", "ms")] = None
    motion: Motion | None = None

    def __post_init__(self) -> None:
        if self.delay is not None:
            finite(delay=self.delay)
        if self.mounting and self.mounting.swings:
            raise ValueError("mounting of a tracker must not swing: it believes one turn")


@dataclass(frozen=True)
class Case:
    """One design in one scene: everything that a trial needs except its attitude and its noise.

    An epoch and an orbital velocity that the catalogue leaves out (None) are set by `seen_from`,
    from the date and the orbit of the scene; those of the tracker's catalogue are then the same.

    Raises  ValueError where the catalogue contradicts the scene.
    """

    instrument: Instrument
    tracker: Tracker = field(default_factory=Tracker)
    scene: Scene = field(default_factory=Scene)
    catalog: Selection = field(default_factory=Selection)

    def __post_init__(self) -> None:
        catalog = seen_from(self.scene, self.catalog)
        object.__setattr__(self, "catalog", catalog)
        if self.tracker.catalog:
            believed = believed_from(self.scene, catalog, self.tracker.catalog)
            object.__setattr__(self, "tracker", replace(self.tracker, catalog=believed))

    @property
    def believed_camera(self) -> Camera:
        """The camera that the tracker computes with."""
        return self.tracker.camera or self.instrument.camera

    @property
    def believed_catalog(self) -> Selection:
        """The catalogue that the tracker carries."""
        return self.tracker.catalog or self.catalog

    @property
    def believed_mounting(self) -> Mounting:
        """How the tracker believes the camera to sit."""
        return self.tracker.mounting or self.instrument.mounting.still

    @property
    def believed_motion(self) -> Motion:
        """How the tracker believes the camera to turn; its rates count."""
        return self.tracker.motion or self.instrument.motion

    @property
    def time_tag_error(self) -> float:
        """Second, from the middle of the exposure to the time that the tracker states."""
        believed = self.tracker.delay
        return 0.0 if believed is None else self.instrument.delay - believed
