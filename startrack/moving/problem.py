"""MovingProblem: a search for moving objects as a problem for searches, samples and tests."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from startrack.core import Floats, Refused, Rows, arcsec, inputs_of
from startrack.design import bounds_of, followed, number_at, replaced_all
from startrack.io import to_table
from startrack.metrics import Interval, level_interval
from startrack.moving.camera import flux_of, magnitude_of
from startrack.moving.detect import find, refined, score_maps, threshold_of
from startrack.moving.forecast import forecast_moving
from startrack.moving.render import SearchedField, added_images, field_of
from startrack.moving.study import MovingDesign, SearchCampaign
from startrack.problem import Bounds, Expectation, Judgement, Margin, TrialImage, TrialView, Words

FRACTIONS = {"limit 50": 0.5, "limit 90": 0.9}
CLOSE = 0.005  # relative, of the flux with which an object is found
ROUNDS = 4
BRIGHTEST = 1e9  # microjansky, of an object that is not found, where numbers must be finite
MOST_SHOWN = 4  # images of a trial
APART = 3.0  # pixel from image to image; the predicted error of a place holds for larger motions
LEFT_OUT = (
    "light of the Sun, Moon and Earth in the optics",
    "cosmic rays and hot pixels",
    "the reference of stars that are searched again in other nights",
)


@dataclass(frozen=True)
class MovingProblem:
    """The camera of a design, and the faintest objects that it finds.

    A trial is one field with one object: its frames are rendered, registered on guide stars and
    added, and the faintest flux is found with which the object passes the threshold.
    """

    design: MovingDesign

    def __post_init__(self) -> None:
        for variable in self.campaign.variables:
            number_at(self.design, variable.name)

    columns = np.dtype([("flux", float), ("x", float), ("y", float)])
    conditions: ClassVar = ("nominal",)
    fidelities: ClassVar = ("image",)
    per_image: ClassVar = 1

    @property
    def campaign(self) -> SearchCampaign:
        """The question."""
        return self.design.campaign

    @property
    def settings(self) -> SearchCampaign:
        """Settings of the search."""
        return self.campaign

    @cached_property
    def variables(self) -> list[Bounds]:
        """Variables of a search."""
        return bounds_of(self.design, self.campaign.variables)

    def replaced(self, values: Mapping[str, float]) -> MovingProblem:
        """The problem with other values (SI) of parameters, and of parameters linked to them.

        Raises  ValueError with the name, where the parameter refuses the value.
        """
        changed = followed(self.design, values, self.campaign.links)
        return MovingProblem(replaced_all(self.design, changed))

    def costs(self) -> dict[str, Margin]:
        """Margins of aperture, field and time."""
        own, limits, instrument = (
            self.design.moving_object,
            self.campaign.requirements,
            self.design.instrument,
        )
        time = own.images * own.frames * instrument.detector.exposure
        every = {
            "aperture": (instrument.optics.aperture, limits.max_aperture, True, "m"),
            "field": (self.design.field, limits.min_field, False, "deg2"),
            "time": (time, limits.max_time, True, "s"),
        }
        return {
            name: Margin(value, limit, most, unit)
            for name, (value, limit, most, unit) in every.items()
            if limit is not None
        }

    def expect(self) -> Expectation:
        """Limits and place by formula."""
        found = forecast_moving(self.design)
        values = dict(zip(FRACTIONS, found.limits, strict=True)) | {"place": found.place / arcsec}
        parts = dict(values)
        for name in FRACTIONS:
            parts[f"{name} V"] = magnitude_of(values[name]) if values[name] < math.inf else math.nan
        margins = {
            name: Margin(values[name], limit, most=True, unit=unit)
            for name, limit, unit in self._limits()
        }
        own = self.design.moving_object
        moved, left_out = own.rate * own.interval / self.design.pixel, list(LEFT_OUT)
        if moved < APART:
            left_out.append(
                f"the object in the mean of the other images: it moves by {moved:.1f} pixels "
                "between images, which increases the error of its place by up to a fifth"
            )
        return Expectation(values[self.campaign.objective], margins, parts, tuple(left_out))

    def _limits(self) -> list[tuple[str, float, str]]:
        needs = self.campaign.requirements
        limits = list[tuple[str, float, str]]()
        if needs.min_magnitude is not None:
            limits.append(("limit 90", flux_of(needs.min_magnitude), "uJy"))
        if needs.max_place_error is not None:
            limits.append(("place", needs.max_place_error / arcsec, "arcsec"))
        return limits

    def trials(self, seed: int, numbers: range) -> Rows:
        """A field with an object for each number, the same for any worker."""
        rows = np.zeros(len(numbers), self.columns)
        for row, number in zip(rows, numbers, strict=True):
            row["flux"], (row["x"], row["y"]) = run_moving_trial(self.design, seed, number)
        return rows

    def view(self, seed: int, number: int, condition: str = "nominal") -> TrialView:
        """The images of a trial with the object whose place is measured.

        Raises  ValueError for a condition other than "nominal".
        """
        if condition not in self.conditions:
            raise Refused(f"conditions must be names of nominal, got {condition!r}")
        own, field = self.design.moving_object, field_of(self.design, seed, number)
        seen, limit = bright_object(self.design, field), threshold_of(self.design)
        middle = np.array(seen.images.shape[:0:-1]) // 2
        times = np.array(own.times)[:, None]
        moved = middle + field.rest.mean(1)
        true = field.place + field.speed * times + moved
        shown = seen.place + seen.end * times / own.times[-1] + moved
        word = "object found" if seen.score > limit else "object missed"
        layers = {"": seen.images, " without stars": seen.clean}
        images = tuple(
            TrialImage(
                f"image {n + 1} of {own.images}{words}",
                "electron",
                image,
                {word: shown[n : n + 1], "true place of this trial": true[n : n + 1]},
                scale=f"images{words}",
            )
            for words, every in layers.items()
            for n, image in enumerate(every[:MOST_SHOWN])
        )
        error = float(np.hypot(*(seen.place - field.place))) * self.design.pixel / arcsec
        text = (
            f"an object of V {own.magnitude:g} has a score of {seen.score:.2f}, objects above "
            f"{limit:.2f} are found; the error of its place is {error:.3g} arcsec"
        )
        return TrialView(images, text)

    def judge(self, rows: Rows, confidence: float = 0.95) -> Judgement:
        """Limits and place, with intervals of a confidence."""
        fluxes = np.minimum(rows["flux"], BRIGHTEST)
        intervals = dict[str, Interval]()
        for name, found in FRACTIONS.items():
            level = level_interval(fluxes, found, confidence)
            ends = (level.value, level.low, level.high)
            intervals[name] = Interval(*(math.inf if x >= BRIGHTEST / 1e3 else x for x in ends))
        away = np.hypot(rows["x"], rows["y"]) / arcsec
        intervals["place"] = level_interval(away, 0.5, confidence)
        margins = {}
        for name, limit, unit in self._limits():
            own = intervals[name]
            value, near, far = (
                Margin(x, limit, most=True, unit=unit) for x in (own.value, own.high, own.low)
            )
            margins[name] = value, near, far
        parts = dict(intervals)
        for name in FRACTIONS:
            own = intervals[name]
            parts[f"{name} V"] = Interval(*map(_magnitude, (own.value, own.high, own.low)))
        return Judgement(intervals[self.campaign.objective], margins, parts)

    def described(self) -> str:
        """All inputs of the results."""
        return json.dumps([to_table(self.design), inputs_of(self.design)], sort_keys=True)

    def text(self) -> Words:
        """Names and units."""
        own = self.design.moving_object
        parts = {
            name: (f"flux of the objects of which {found:.0%} are found", "uJy")
            for name, found in FRACTIONS.items()
        }
        parts["place"] = f"median error of the place of an object of V {own.magnitude:g}", "arcsec"
        for name, found in FRACTIONS.items():
            parts[f"{name} V"] = f"magnitude V of these, {found:.0%}", "mag"
        value, unit = parts[self.campaign.objective]
        return Words(value, unit, parts)


class SeenObject(NamedTuple):
    """The object whose place is measured, in the images of a field.

    images  (images, h, w) electron
    clean   likewise, without sky and stars: less the mean of the other images
    score   of the search
    place   (2,) pixel at the middle time, from the middle
    end     (2,) pixel, found motion from the middle time to the last image
    """

    images: Floats
    clean: Floats
    score: float
    place: Floats
    end: Floats


def bright_object(design: MovingDesign, field: SearchedField) -> SeenObject:
    """The object of the requested magnitude, as it is found in the images of a field."""
    images = added_images(design, field, flux_of(design.moving_object.magnitude))
    maps = score_maps(design, images, field.angle)
    score, at = find(design, maps, field.place, field.speed, field.rest)
    place = refined(design, maps, at, field.angle, field.rest)
    return SeenObject(images, maps.clean, score, place, at[2:])


def run_moving_trial(
    design: MovingDesign, seed: int, number: int
) -> tuple[float, tuple[float, float]]:
    """Flux (microjansky) at which the object of a field is just detected; error of another one's
    place.

    The noise is the same for all fluxes, so that the score rises with the flux. The place (radian
    along columns and rows) is for an object of the requested magnitude.

    Raises  Refused if the forecast has no limit to begin with.
    """
    limit, field = threshold_of(design), field_of(design, seed, number)
    expected = forecast_moving(design).limits[0]
    if not math.isfinite(expected):
        raise Refused("an object of any brightness must be found by formula, but none is")

    def score(flux: float) -> float:
        maps = score_maps(design, added_images(design, field, flux), field.angle)
        return find(design, maps, field.place, field.speed, field.rest)[0]

    flux = _crossing(score, limit, expected)
    error = (bright_object(design, field).place - field.place) * design.pixel
    return flux, (float(error[0]), float(error[1]))


def _magnitude(flux: float) -> float:
    """V of a flux that may be zero or infinite."""
    if 0 < flux < math.inf:
        return magnitude_of(flux)
    return math.inf if flux <= 0 else -math.inf


def _crossing(score: Any, limit: float, guess: float) -> float:
    """Argument at which a rising score passes a limit, by secants of a nearly straight line."""
    points: list[tuple[float, float]] = []
    flux = guess
    for _ in range(ROUNDS):
        points.append((flux, score(flux)))
        if len(points) == 1:
            new = flux * limit / max(points[0][1], limit / 4)
        else:
            (a, low), (b, high) = sorted(points, key=lambda point: abs(point[1] - limit))[:2]
            slope = (high - low) / (b - a) if b != a else 0.0
            new = a + (limit - low) / slope if slope > 0 else flux * 1.5
        new = min(max(new, 0.2 * flux), 5 * flux)
        if abs(new / flux - 1) < CLOSE:
            return float(new)
        flux = new
    return float(flux)
