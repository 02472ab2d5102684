"""Criteria of each retrieval: names, values by formula and values by trials."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from startrack.core import Floats
from startrack.earth.retrieval import fire, hot_spots, land_cover, minerals, stereo, views, waves
from startrack.earth.retrieval.fire_forecast import forecast_fires
from startrack.earth.retrieval.study import EarthDesign
from startrack.metrics import Interval, fraction_interval, level_interval, rms_interval
from startrack.problem import TrialView

LARGEST = 1e12  # square metre; area of a fire that is not found, where numbers must be finite


class Criterion(NamedTuple):
    """A figure of merit of a retrieval; smaller is better.

    words      name for messages and tables
    unit       text; "" for a pure number
    objective  name of the campaign's objective that uses this criterion
    limit      key of its limit in the campaign's requirements
    column     column of the rows from which it is computed
    """

    words: str
    unit: str
    objective: str
    limit: str
    column: str


class RetrievalStudy(Protocol):
    """The retrieval of a design in one condition."""

    @property
    def criteria(self) -> dict[str, Criterion]:
        """Criteria by name."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the numbers in the row of one trial."""

    @property
    def per_image(self) -> int:
        """Number of trials of one image."""

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects that formulas and trials leave out, in words."""

    def expected(self) -> dict[str, float]:
        """Value of each criterion by formula."""

    def image(self, seed: int, number: int) -> dict[str, Floats]:
        """Values (n,) of each column, for the trials of one image."""

    def view(self, seed: int, number: int, trial: int) -> TrialView:
        """Images of an image's trial, from the same functions as its values.

        trial  number of the trial among those of the image
        """

    def shown(self, name: str, values: Floats, confidence: float = 0.95) -> Interval:
        """The criterion from (n,) values of its column."""


def study_of(design: EarthDesign) -> RetrievalStudy:
    """The study of the retrieval of a design.

    Raises  ValueError if the retrieval cannot use the Sun at `retrieval.latitude`.
    """
    assert design.retrieval
    own = design.retrieval.below(design.carrier)
    if own.minerals:
        return Spectra(design, own.minerals)
    if own.land_cover:
        return MosaicStudy(design, own.land_cover)
    if own.stereo:
        return TerrainStudy(design, own.stereo)
    if own.waves:
        return SeaStudy(design, own.waves)
    assert own.hot_spots
    return Fires(design, own.hot_spots)


class Fires(NamedTuple):
    """Smallest detectable fires, and the error of their radiative power."""

    design: EarthDesign
    spots: hot_spots.HotSpots

    @property
    def criteria(self) -> dict[str, Criterion]:
        """As in `RetrievalStudy`."""
        own = self.spots
        areas = {
            f"area {kelvin:g} K": Criterion(
                words=f"smallest fire of {kelvin:g} K found in {own.found:.0%}",
                unit="m2",
                objective="area",
                limit="max_area",
                column=f"area {kelvin:g} K",
            )
            for kelvin in own.temperatures
        }
        words = f"error of the radiative power of {own.area:g} m2 at {own.temperature:g} K"
        return areas | {"power": Criterion(words, "", "power", "max_power_error", "power")}

    @property
    def columns(self) -> tuple[str, ...]:
        """As in `RetrievalStudy`; temperature and area are NaN where two bands have none."""
        return (*self.criteria, "temperature", "estimated area")

    @property
    def per_image(self) -> int:
        """As in `RetrievalStudy`."""
        return self.spots.per_image

    @property
    def left_out(self) -> tuple[str, ...]:
        """As in `RetrievalStudy`."""
        out = ["oblique lines of sight, relief and clouds", "the registration of both channels"]
        if any(not channel.optics.plain for channel in self.design.camera.channels):
            out.append("formulas alone: the pupil's shape, segments, defocus and aberrations")
        return tuple(out)

    def expected(self) -> dict[str, float]:
        """As in `RetrievalStudy`."""
        found = forecast_fires(self.design, self.spots)
        return dict(zip(self.criteria, (*found.areas, found.power_error), strict=True))

    def image(self, seed: int, number: int) -> dict[str, Floats]:
        """As in `RetrievalStudy`."""
        spots = self.spots
        seen = hot_spots.views_of(self.design, spots)
        image = hot_spots.image_of(self.design, spots, seen, seed, number)
        columns = dict[str, Floats]()
        guesses = forecast_fires(self.design, spots).areas
        for name, kelvin, guess in zip(self.criteria, spots.temperatures, guesses, strict=False):
            begin = guess if 0 < guess < math.inf else seen.mid.across * seen.mid.along / 100
            columns[name] = hot_spots.smallest_areas(seen, image, spots, kelvin, begin)
        found = hot_spots.measure(seen, image, spots)
        true = fire.radiated_power(spots.temperature, spots.area)
        return columns | {
            "power": found.power / true - 1,
            "temperature": found.temperature,
            "estimated area": found.area,
        }

    def view(self, seed: int, number: int, trial: int) -> TrialView:
        """As in `RetrievalStudy`."""
        return views.view_fires(self.design, self.spots, seed, number, trial)

    def shown(self, name: str, values: Floats, confidence: float = 0.95) -> Interval:
        """As in `RetrievalStudy`.

        The criterion of an area is a quantile of the smallest detectable areas of all fires. Its
        interval assumes independent trials.
        """
        if name == "power":
            return rms_interval(values**2, confidence)
        interval = level_interval(np.minimum(values, LARGEST), self.spots.found, confidence)
        ends = (interval.value, interval.low, interval.high)
        return Interval(*(math.inf if end > LARGEST / 1e3 else end for end in ends))


@dataclass(frozen=True)
class Spectra:
    """Emissivity of minerals, and their classes; members as in `RetrievalStudy`."""

    criteria: ClassVar = {
        "emissivity": Criterion(
            words="rms error of emissivity",
            unit="",
            objective="emissivity",
            limit="max_emissivity_error",
            column="square of emissivity",
        ),
        "wrong": Criterion(
            words="fraction of spectra classified wrongly",
            unit="",
            objective="wrong",
            limit="max_wrong",
            column="wrong",
        ),
    }
    columns: ClassVar = ("square of emissivity", "wrong", "temperature", "christiansen")
    left_out: ClassVar = ("the optics' blur between spectra", "smile and keystone")

    design: EarthDesign
    own: minerals.Minerals

    @property
    def per_image(self) -> int:
        """As in `RetrievalStudy`."""
        return self.own.pixels

    def expected(self) -> dict[str, float]:
        """As in `RetrievalStudy`."""
        found = minerals.forecast_minerals(self.design, self.own)
        return {"emissivity": found.emissivity_error, "wrong": found.wrong}

    def image(self, seed: int, number: int) -> dict[str, Floats]:
        """As in `RetrievalStudy`."""
        spectra = minerals.observe_minerals(self.design, self.own, seed, number)
        found = minerals.identify_minerals(self.design, self.own, spectra.radiance)
        return {
            "square of emissivity": ((found.emissivity - spectra.emissivity) ** 2).mean(1),
            "wrong": (found.mineral != spectra.mineral).astype(float),
            "temperature": found.temperature - spectra.temperature,
            "christiansen": found.christiansen - spectra.christiansen,
        }

    def view(self, seed: int, number: int, trial: int) -> TrialView:
        """As in `RetrievalStudy`."""
        return views.view_spectra(self.design, self.own, seed, number, trial)

    def shown(self, name: str, values: Floats, confidence: float = 0.95) -> Interval:
        """As in `RetrievalStudy`."""
        if name == "wrong":
            return fraction_interval(int(values.sum()), len(values), confidence)
        return rms_interval(values, confidence)


@dataclass(frozen=True)
class MosaicStudy:
    """Reflectance of land, an index, and classes of pixels; members as in `RetrievalStudy`."""

    criteria: ClassVar = {
        "reflectance": Criterion(
            words="rms error of reflectance",
            unit="",
            objective="reflectance",
            limit="max_reflectance_error",
            column="square of reflectance",
        ),
        "index": Criterion(
            words="rms error of the index",
            unit="",
            objective="index",
            limit="max_index_error",
            column="square of index",
        ),
        "wrong": Criterion(
            words="fraction of pixels classified wrongly",
            unit="",
            objective="wrong",
            limit="max_wrong",
            column="wrong",
        ),
    }
    columns: ClassVar = ("square of reflectance", "square of index", "wrong")
    per_image: ClassVar = 1
    left_out: ClassVar = (
        "errors of calibration and of the air's visibility",
        "oblique lines of sight, relief and clouds",
        "the registration of channels",
    )

    design: EarthDesign
    own: land_cover.LandCover

    def expected(self) -> dict[str, float]:
        """As in `RetrievalStudy`."""
        return dict(
            zip(self.criteria, land_cover.forecast_land(self.design, self.own), strict=True)
        )

    def image(self, seed: int, number: int) -> dict[str, Floats]:
        """As in `RetrievalStudy`."""
        own = self.own
        image = land_cover.observe_land(self.design, own, seed, number)
        index = (land_cover.index_of(own, part) for part in (image.measured, image.truth))
        cover = land_cover.classify_land(self.design, own, image.measured)
        return {
            "square of reflectance": np.array([((image.measured - image.truth) ** 2).mean()]),
            "square of index": np.array([((next(index) - next(index)) ** 2).mean()]),
            "wrong": np.array([(cover != image.cover).mean()]),
        }

    def view(self, seed: int, number: int, trial: int) -> TrialView:
        """As in `RetrievalStudy`."""
        return views.view_land(self.design, self.own, seed, number, trial)

    def shown(self, name: str, values: Floats, confidence: float = 0.95) -> Interval:
        """As in `RetrievalStudy`."""
        interval = rms_interval(values, confidence)
        if name != "wrong":
            return interval
        return Interval(*(end**2 for end in (interval.value, interval.low, interval.high)))


@dataclass(frozen=True)
class TerrainStudy:
    """Heights of terrain from two images along the track; members as in `RetrievalStudy`.

    columns  squared error of matched pixels, and the unmatched fraction
    """

    criteria: ClassVar = {
        "height": Criterion(
            words="rms error of heights",
            unit="m",
            objective="height",
            limit="max_height_error",
            column="square of height",
        )
    }
    columns: ClassVar = ("square of height", "unmatched")
    per_image: ClassVar = 1
    left_out: ClassVar = (
        "errors of orientation and of the camera's calibration",
        "shading, hidden ground, buildings and trees",
        "pixels whose match is rejected",
    )

    design: EarthDesign
    own: stereo.Stereo

    def expected(self) -> dict[str, float]:
        """As in `RetrievalStudy`."""
        return {"height": stereo.forecast_heights(self.design, self.own).height_error}

    def image(self, seed: int, number: int) -> dict[str, Floats]:
        """As in `RetrievalStudy`."""
        images = stereo.observe_terrain(self.design, self.own, seed, number)
        found = stereo.match_heights(self.design, self.own, images)
        errors = (found.height - images.height)[found.matched]
        square = (errors**2).mean() if len(errors) else math.inf
        return {
            "square of height": np.array([square]),
            "unmatched": np.array([1 - found.matched.sum() / max(found.inside.sum(), 1)]),
        }

    def view(self, seed: int, number: int, trial: int) -> TrialView:
        """As in `RetrievalStudy`."""
        return views.view_terrain(self.design, self.own, seed, number, trial)

    def shown(self, name: str, values: Floats, confidence: float = 0.95) -> Interval:
        """As in `RetrievalStudy`."""
        return rms_interval(values, confidence)


@dataclass(frozen=True)
class SeaStudy:
    """Height and direction of waves in the glint; members as in `RetrievalStudy`.

    columns  the last one is the relative error of the spectrum's peak
    """

    criteria: ClassVar = {
        "wave height": Criterion(
            words="rms error of significant wave height",
            unit="m",
            objective="wave height",
            limit="max_wave_height_error",
            column="square of wave height",
        ),
        "wave direction": Criterion(
            words="rms error of the waves' direction, without its sense",
            unit="rad",
            objective="wave direction",
            limit="max_wave_direction_error",
            column="square of wave direction",
        ),
    }
    columns: ClassVar = ("square of wave height", "square of wave direction", "wavelength")
    per_image: ClassVar = 1
    left_out: ClassVar = (
        "errors of the wind and of the light of air, sky and water (assumed to be known)",
        "non-linear waves, currents, a second wave system, foam in patches",
        "oblique lines of sight, and the edges of an image: waves are periodic over the image",
        "formulas alone: products of four and more waves; errors of trials were 0.87 to 1.06 "
        "times the errors by formula over twelve designs (0.87 for wave heights under a Sun 15 "
        "degrees from the zenith)",
    )

    design: EarthDesign
    own: waves.Waves

    def expected(self) -> dict[str, float]:
        """As in `RetrievalStudy`."""
        found = waves.forecast_waves(self.design, self.own)
        return {"wave height": found.height_error, "wave direction": found.direction_error}

    def image(self, seed: int, number: int) -> dict[str, Floats]:
        """As in `RetrievalStudy`."""
        image = waves.observe_waves(self.design, self.own, seed, number)
        found = waves.retrieve_waves(self.design, self.own, image.radiance)
        turn = math.remainder(found.direction - image.direction, math.pi)
        return {
            "square of wave height": np.array([(found.height - image.height) ** 2]),
            "square of wave direction": np.array([turn**2]),
            "wavelength": np.array([found.wavelength / self.own.peak_wavelength - 1]),
        }

    def view(self, seed: int, number: int, trial: int) -> TrialView:
        """As in `RetrievalStudy`."""
        return views.view_sea(self.design, self.own, seed, number, trial)

    def shown(self, name: str, values: Floats, confidence: float = 0.95) -> Interval:
        """As in `RetrievalStudy`."""
        return rms_interval(values, confidence)
