"""MovingDesign: a camera, the images of a field, the objects that are searched, and their file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from startrack.core import DAY, POSITIVE, Parameters, Range, Refused, Unit, deg, parameter
from startrack.design import (
    OF_FILES,
    Instrument,
    Key,
    Link,
    Variable,
    differences,
    keys_of,
    load_design,
    save_over,
    with_changes,
)
from startrack.io import (
    LayerRules,
    Layers,
    from_table,
    read_layers,
    refuse_unknown,
    shipped,
    to_table,
)
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


KEYS = "instrument", "scene", "moving_object", "campaign"
CAMERA = Key(
    "camera",
    "text",
    "",
    "",
    "required",
    "design file, or the name of a camera of the catalogue, whose instrument is taken",
)


def moving_keys() -> tuple[Key, ...]:
    """All keys that a file of a search for moving objects may have."""
    keys = keys_of(MovingDesign)
    return (*OF_FILES, CAMERA, *(key for key in keys if key.name.partition(".")[0] in KEYS))


def load_moving_design(search: str | Path, changes: Sequence[str] = ()) -> MovingDesign:
    """A design from a file, or from one of the catalogue by its name.

    The key `camera` names a design file of a star tracker, or one of the catalogue's cameras, whose
    instrument and scene are taken. A table [scene] replaces that of the camera. `base` and
    `include` take the values of other files, see `read_layers`; the table [instrument] changes
    values of their camera.

    changes  values that replace the file's: "instrument.optics.f_number=2.5"
    Raises   ValueError with the position in the file, the rule and the value.
    """
    path = Path(search)
    if path.suffix != ".toml":
        path = shipped(f"searches/{search}.toml")
    named = list[Path]()

    def resolved(own: dict[str, Any], file: Path) -> dict[str, Any]:
        if "camera" in own:
            named.append(file)
        return _with_camera(own, file.parent)

    rules = LayerRules(resolved=resolved)
    table = read_layers(path, "a search for moving objects", (), rules).table
    if len(named) != 1:  # the values of two cameras would be mixed
        files = ", ".join(map(str, named)) or "none"
        raise Refused(f"{path}: camera must be named by one file, got {files}")
    for key in table:
        if key not in KEYS:
            raise Refused(f"{key} must be one of camera, {', '.join(KEYS)}")
    refuse_unknown(
        (Instrument, table["instrument"], "instrument"),
        (Scene, table.get("scene"), "scene"),
        (MovingObject, table.get("moving_object"), "moving_object"),
        (SearchCampaign, table.get("campaign"), "campaign"),
    )
    design = MovingDesign(
        from_table(Instrument, table["instrument"], "instrument"),
        from_table(Scene, table.get("scene", {}), "scene"),
        from_table(MovingObject, table.get("moving_object", {}), "moving_object"),
        from_table(SearchCampaign, table.get("campaign", {}), "campaign"),
    )
    return with_changes(design, changes)


def _with_camera(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The table of a file with the instrument and the scene of its camera."""
    if "camera" not in table:
        return table
    camera = str(table.pop("camera"))
    file = folder / camera if camera.endswith(".toml") else shipped(f"cameras/{camera}.toml")
    case, layers = load_design(file).case, Layers()
    layers.lay({"instrument": to_table(case.instrument)}, "")
    layers.lay({"scene": to_table(case.scene)} | table, "")
    return layers.table


def save_moving_overlay(path: Path, design: MovingDesign, base: Path, comment: str = "") -> None:
    """Write the differences of a design from its file, with all digits, as such a file.

    Raises  Refused if the file does not read back to the design.
    """
    table = differences(to_table(load_moving_design(base)), to_table(design))
    save_over(path, base, table, comment)
    if load_moving_design(path) != design:
        raise Refused(
            f"{path} must read back to the design, but it does not: a value of {base.name} cannot "
            "be removed by a file over it"
        )
