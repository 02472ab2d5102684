"""MovingDesign: a camera, the images of a field, the objects that are searched, and their file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from startrack.core import DAY, POSITIVE, Parameters, Range, Refused, Unit, deg, parameter
from startrack.design import Instrument, Key, Link, Variable, keys_of, load_design, with_changes
from startrack.io import from_table, read_table, refuse_unknown, shipped
from startrack.problem import Settings
from startrack.scene import Scene


class MovingObject(Parameters):
    """Images of a field, and the objects that move in it.

    An image is the sum of frames of one exposure each, shifted by whole pixels so that guide stars
    stay in their places.
    """

    images: int = parameter("of a field", limit=Range(3, 30), default=4)
    frames: int = parameter("that are added to an image", limit=Range(1, 2000), default=50)
    interval: float = parameter(
        "from the middle of an image to that of the next",
        unit=Unit("s", "min"),
        limit=POSITIVE,
        default=300.0,
    )
    rate: float = parameter(
        "of the objects, in a random direction",
        unit=Unit("rad / s", "deg / d"),
        limit=POSITIVE,
        default=deg / DAY,
    )
    fastest: float = parameter(
        "of the motions that are searched, in any direction",
        unit=Unit("rad / s", "deg / d"),
        limit=POSITIVE,
        default=2 * deg / DAY,
    )
    false_alarms: float = parameter(
        "expected in the search of all pixels of the detector for all motions",
        limit=Range(1e-6, 100),
        default=1.0,
    )
    magnitude: float = parameter(
        "V, of the object whose place is measured", limit=Range(5, 25), default=18.0
    )
    guides: int = parameter("guide stars in the field", limit=Range(1, 50), default=4)
    guide_g: float = parameter(
        "magnitude of the guide stars; where these would saturate, fainter ones are taken",
        limit=Range(0, 18),
        default=9.5,
    )
    stars: float = parameter(
        "other stars of G 18 and brighter, per square degree; assumed: at a galactic latitude of "
        "about 45 degrees",
        limit=Range(0, 1e5),
        default=2500.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate > self.fastest:
            raise Refused(
                f"rate must be at most fastest, {self.fastest * DAY / deg:g} deg / d, got "
                f"{self.rate * DAY / deg:g}"
            )

    @property
    def times(self) -> list[float]:
        """Second of the middle of each image, from the middle of all."""
        middle = (self.images - 1) / 2
        return [(number - middle) * self.interval for number in range(self.images)]


class SearchLimits(Parameters):
    """Requirements on a search for moving objects; None: no limit."""

    max_aperture: float | None = parameter(unit=Unit("m", "mm"), limit=POSITIVE, default=None)
    min_field: float | None = parameter(
        "of the detector, square degree", limit=POSITIVE, default=None
    )
    max_time: float | None = parameter(
        "of all exposures of a field together", unit=Unit("s"), limit=POSITIVE, default=None
    )
    min_magnitude: float | None = parameter(
        "V, of the objects of which 90 % are found", limit=Range(0, 30), default=None
    )
    max_place_error: float | None = parameter(
        "median distance, of the object whose place is measured",
        unit=Unit("rad", "arcsec"),
        limit=POSITIVE,
        default=None,
    )


class SearchCampaign(Settings):
    """The question that is put to a search for moving objects."""

    variables: tuple[Variable, ...] = parameter("what may change", default=())
    links: tuple[Link, ...] = parameter("what follows them", default=())
    requirements: SearchLimits = parameter("what must hold", default_factory=SearchLimits)
    objective: str = parameter(
        '"limit 50" or "limit 90": flux of the objects of which that percentage is found; "place": '
        "the error of the place",
        limit=Range(choices=("limit 50", "limit 90", "place")),
        default="limit 50",
    )


class MovingDesign(Parameters):
    """A camera on the sky, the images of a field, and the question put to it."""

    instrument: Instrument
    scene: Scene
    moving_object: MovingObject = parameter(default_factory=MovingObject)
    campaign: SearchCampaign = parameter(default_factory=SearchCampaign)

    def __post_init__(self) -> None:
        super().__post_init__()
        optics, detector = self.instrument.optics, self.instrument.detector
        if optics.tabulated:
            raise Refused("optics.lens_file must be left out where moving objects are searched")
        if detector.scan is not None:
            raise Refused("detector.scan must be left out where moving objects are searched")
        if detector.mosaic is not None:
            raise Refused("detector.mosaic must be left out where moving objects are searched")
        if self.scene.background_g is None:
            raise Refused("scene.background_g must be given where moving objects are searched")
        own = self.moving_object
        if own.frames * detector.exposure > own.interval:
            raise Refused(
                f"moving_object.frames must take at most interval, {own.interval:g} s, got "
                f"{own.frames * detector.exposure:g} s"
            )

    @property
    def pixel(self) -> float:
        """Radian that a pixel spans on the boresight."""
        return self.instrument.detector.pitch / self.instrument.optics.focal_length

    @property
    def field(self) -> float:
        """Square degree of the detector."""
        detector = self.instrument.detector
        sides = (
            2 * math.degrees(math.atan(count * self.pixel / 2))
            for count in (detector.rows, detector.columns)
        )
        return math.prod(sides)


KEYS = "camera", "scene", "moving_object", "campaign"
CAMERA = Key(
    "camera", "text", "", "", "required", "design file, or the name of a camera of the catalogue"
)


def moving_keys() -> tuple[Key, ...]:
    """All keys that a file of a search for moving objects may have."""
    keys = keys_of(MovingDesign)
    return (CAMERA, *(key for key in keys if key.name.partition(".")[0] in KEYS))


def load_moving_design(search: str | Path, changes: Sequence[str] = ()) -> MovingDesign:
    """A design from a file, or from one of the catalogue by its name.

    The key `camera` names a design file of a star tracker, or one of the catalogue's cameras, whose
    instrument and scene are taken.

    changes  values that replace the file's: "instrument.optics.f_number=2.5"
    Raises   ValueError with the position in the file, the rule and the value.
    """
    path = Path(search)
    if path.suffix != ".toml":
        path = shipped(f"searches/{search}.toml")
    table: dict[str, Any] = read_table(path, "a search for moving objects")
    camera = str(table.get("camera", ""))
    file = path.parent / camera if camera.endswith(".toml") else shipped(f"cameras/{camera}.toml")
    case = load_design(file).case
    for key in table:
        if key not in KEYS:
            raise Refused(f"{key} must be one of {', '.join(KEYS)}")
    refuse_unknown(
        (Scene, table.get("scene"), "scene"),
        (MovingObject, table.get("moving_object"), "moving_object"),
        (SearchCampaign, table.get("campaign"), "campaign"),
    )
    design = MovingDesign(
        case.instrument,
        from_table(Scene, table["scene"], "scene") if "scene" in table else case.scene,
        from_table(MovingObject, table.get("moving_object", {}), "moving_object"),
        from_table(SearchCampaign, table.get("campaign", {}), "campaign"),
    )
    return with_changes(design, changes)
