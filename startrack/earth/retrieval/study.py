"""EarthDesign: a scene with its camera, the purpose of its images, and the study's campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from startrack.core import NON_NEGATIVE, POSITIVE, Parameters, Range, Refused, Unit, parameter
from startrack.design import (
    Change,
    Link,
    Variable,
    differences,
    save_over,
    with_changes,
    with_values,
)
from startrack.earth.geometry import Carrier, sun_zenith_below
from startrack.earth.imager import CHANNELS, Channel, Survey, scene_of
from startrack.earth.retrieval.hot_spots import HotSpots
from startrack.earth.retrieval.land_cover import LandCover
from startrack.earth.retrieval.minerals import Minerals
from startrack.earth.retrieval.stereo import Stereo
from startrack.earth.retrieval.waves import Waves
from startrack.io import save_toml, shipped, to_table
from startrack.problem import Settings

OWN = "nominal"  # the file's own condition
PURPOSES = "hot_spots", "minerals", "land_cover", "stereo", "waves"  # tables of a retrieval


class Retrieval(Parameters):
    """Purpose of the images: one of its tables."""

    hot_spots: HotSpots | None = parameter(
        "detection, power and temperature of fires", default=None
    )
    minerals: Minerals | None = parameter("emissivity and classes of minerals", default=None)
    land_cover: LandCover | None = parameter(
        "reflectance of land, an index and classes of its pixels", default=None
    )
    stereo: Stereo | None = parameter("heights from two images along the track", default=None)
    waves: Waves | None = parameter("height and direction of waves in the glint", default=None)
    latitude: float | None = parameter(
        "geodetic latitude of the ground; orbit and date of the pass over it then give the Sun's "
        "zenith angle, in place of the table's `sun_zenith`",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi / 2, math.pi / 2),
        default=None,
    )
    flight: str = parameter(
        "direction of the pass over `latitude`: ascending is northward",
        limit=Range(choices=("ascending", "descending")),
        default="descending",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [name for name in PURPOSES if getattr(self, name) is not None]
        if len(given) != 1:
            raise Refused(f"retrieval must have one table, got {', '.join(given) or 'none'}")
        if self.latitude is not None and (self.minerals or self.waves):
            raise Refused("retrieval.latitude must be left out for minerals and waves")

    def below(self, carrier: Carrier) -> Retrieval:
        """The retrieval with the Sun of the pass over `latitude`."""
        if self.latitude is None:
            return self
        zenith = sun_zenith_below(carrier, self.latitude, self.flight == "ascending")
        for name in PURPOSES:
            if (own := getattr(self, name)) is not None:
                return replace(self, **{name: replace(own, sun_zenith=zenith), "latitude": None})
        return self


class EarthCondition(Parameters):
    """A further condition of the study, besides the condition of the file itself."""

    name: str = parameter("name in tables and messages")
    weight: float = parameter(
        "weight of its criterion in the objective, relative to the file's own condition; 0: only "
        "its limits count",
        limit=NON_NEGATIVE,
        default=1.0,
    )
    change: tuple[Change, ...] = parameter(
        'keys and values that differ, such as "retrieval.hot_spots.sun_zenith"', default=()
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name or self.name == OWN:
            raise Refused(f"name of a condition must be given and not be {OWN}, got {self.name!r}")


class CameraLimits(Parameters):
    """Limits of a camera, besides `required` of its channels; None: no limit.

        mass = mass_fixed + sum over lenses of mass_per_volume aperture^3

    Channels with the same focal length, f-number and view share a lens. The law is the same as for
    star trackers: a lens scales in all directions. Its coefficients are assumed.
    """

    max_mass: float | None = parameter(unit=Unit("kg"), limit=POSITIVE, default=None)
    mass_fixed: float = parameter(
        "mass that does not depend on the aperture; assumed",
        unit=Unit("kg"),
        limit=NON_NEGATIVE,
        default=1.0,
    )
    mass_per_volume: float = parameter(
        "mass of a lens over the cube of its aperture; assumed",
        unit=Unit("kg / m3"),
        limit=NON_NEGATIVE,
        default=6000.0,
    )
    max_aperture: float | None = parameter(
        "limit of the largest lens", unit=Unit("m", "mm"), limit=POSITIVE, default=None
    )
    max_data_rate: float | None = parameter(
        "limit of the sum over channels",
        unit=Unit("bit / s", "Mbit / s"),
        limit=POSITIVE,
        default=None,
    )
    min_swath: float | None = parameter(
        "limit of the narrowest channel", unit=Unit("m", "km"), limit=POSITIVE, default=None
    )
    max_area: float | None = parameter(
        "limit of the smallest detectable fire, at each temperature and in each condition",
        unit=Unit("m2"),
        limit=POSITIVE,
        default=None,
    )
    max_power_error: float | None = parameter(
        "1, limit of the relative rms error of radiative power, in each condition",
        limit=POSITIVE,
        default=None,
    )
    max_emissivity_error: float | None = parameter(
        "1, rms, in each condition", limit=POSITIVE, default=None
    )
    max_wrong: float | None = parameter(
        "1, limit of the fraction of misclassified spectra or pixels, in each condition",
        limit=POSITIVE,
        default=None,
    )
    max_reflectance_error: float | None = parameter(
        "1, rms, in each condition", limit=POSITIVE, default=None
    )
    max_index_error: float | None = parameter(
        "1, rms, in each condition", limit=POSITIVE, default=None
    )
    max_height_error: float | None = parameter(
        "rms, in each condition", unit=Unit("m"), limit=POSITIVE, default=None
    )
    max_wave_height_error: float | None = parameter(
        "rms, in each condition", unit=Unit("m"), limit=POSITIVE, default=None
    )
    max_wave_direction_error: float | None = parameter(
        "rms, in each condition", unit=Unit("rad", "deg"), limit=POSITIVE, default=None
    )

    def mass(self, channels: Sequence[Channel]) -> float:
        """Mass of the camera, kilogram."""
        apertures = lenses_of(channels)
        return self.mass_fixed + sum(self.mass_per_volume * size**3 for size in apertures)


def lenses_of(channels: Sequence[Channel]) -> list[float]:
    """Aperture of each lens, metre; channels that can share a lens share it."""
    lenses = {
        (channel.optics.focal_length, channel.optics.f_number, channel.forwards): channel
        for channel in channels
    }
    return [channel.optics.aperture for channel in lenses.values()]


class EarthCampaign(Settings):
    """The campaign of an Earth camera: its objective, limits, conditions and variables."""

    variables: tuple[Variable, ...] = parameter("what may change", default=())
    links: tuple[Link, ...] = parameter("what follows them", default=())
    conditions: tuple[EarthCondition, ...] = parameter(
        "further seasons, hours and grounds of the study, besides the file's own condition",
        default=(),
    )
    requirements: CameraLimits = parameter("what must hold", default_factory=CameraLimits)
    objective: str = parameter(
        '"area": smallest detectable fire, geometric mean over temperatures; "power": relative '
        'error of the radiative power; "emissivity", "reflectance", "index", "height", "wave '
        'height", "wave direction": rms error; "wrong": fraction of misclassified spectra or '
        "pixels. Several conditions: geometric mean with their weights",
        limit=Range(
            choices=(
                "area",
                "power",
                "emissivity",
                "reflectance",
                "index",
                "wrong",
                "height",
                "wave height",
                "wave direction",
            )
        ),
        default="area",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [condition.name for condition in self.conditions]
        if len(set(names)) < len(names):
            raise Refused(f"conditions must have different names, got {', '.join(names)}")


class EarthDesign(Survey):
    """A scene, the purpose of its images, and the campaign of its camera."""

    # Short names of tables in names of parameters.
    ALIASES: ClassVar[Mapping[str, str]] = {"channels": "camera.channels"}

    retrieval: Retrieval | None = parameter("purpose of the images", default=None)
    campaign: EarthCampaign | None = parameter(
        "objective, limits and variables of the study", default=None
    )

    def __hash__(self) -> int:
        return hash((self.camera, self.orbit, self.retrieval, self.campaign))

    def conditions(self) -> dict[str, tuple[float, EarthDesign]]:
        """Weight and design of each condition, the file's own condition first.

        Raises  ValueError if a changed value is not allowed.
        """
        made: dict[str, tuple[float, EarthDesign]] = {OWN: (1.0, self)}
        for condition in self.campaign.conditions if self.campaign else ():
            values = {change.name: change.value for change in condition.change}
            try:
                made[condition.name] = condition.weight, with_values(self, values)
            except Refused as error:
                raise Refused(f"condition {condition.name}: {error}") from None
        return made


def load_earth_design(scene: str | Path, changes: Sequence[str] = ()) -> EarthDesign:
    """A design from a scene file, or from a scene of the catalogue by name.

    changes  values that replace the file's: "channels.mir.optics.f_number=2.5"
    Raises   ValueError as `load_survey`, and where a change cannot be read.
    """
    name = str(scene)
    path = Path(scene)
    if not name.endswith(".toml"):
        known = sorted(file.stem for file in shipped("scenes").glob("*.toml"))
        if name not in known:
            raise Refused(f"scene must be a TOML file or one of {', '.join(known)}, got {name!r}")
        path = shipped(f"scenes/{name}.toml")
    design = scene_of(EarthDesign, path)
    return with_changes(design, changes)


def save_earth_overlay(path: Path, design: EarthDesign, base: Path, comment: str = "") -> None:
    """Write the differences of a design from its scene file, with all digits, as a scene file.

    If it does not read back to the design, the whole design is written.
    """
    table = differences(to_table(load_earth_design(base)), to_table(design), (CHANNELS,))
    save_over(path, base, table, comment)
    if load_earth_design(path) != design:
        save_toml(path, to_table(design), comment)
