"""EarthProblem: an Earth camera as a problem for searches, samples and tests of requirements.

A problem has parameters by name, costs, a forecast by formula, trials by number, and a judgement of
their rows; it says in words what its values are.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Refused, inputs_of, printed
from startrack.design import number_at, replaced_all, unchecked
from startrack.earth.geometry import flight_height, ground_rate
from startrack.earth.imager import figures, known, margins_of
from startrack.earth.retrieval import fire, hot_spots
from startrack.earth.retrieval.fire_forecast import band_in, forecast_fires
from startrack.earth.retrieval.hot_spots import HotSpots
from startrack.earth.retrieval.study import CameraLimits, EarthCampaign, EarthDesign, lenses_of
from startrack.io import to_table
from startrack.metrics import Interval, level_interval, rms_interval

IMAGE = "image"
LARGEST = 1e12  # square metre, of a fire that is not found, where numbers must be finite


@printed
class Margin(NamedTuple):
    """A value beside its limit.

    value, limit  in one unit
    most          whether the limit is from above
    unit          as a text, "" for a pure number
    """

    value: float
    limit: float
    most: bool
    unit: str = ""

    @property
    def relative(self) -> float:
        """Over the limit; met where it is 0 or more."""
        part = self.value / self.limit - 1
        return -part if self.most else part


@printed
class Forecast(NamedTuple):
    """What is expected by formula.

    value     the objective, in the unit of `Words`
    margins   by the names of limits
    parts     each criterion by its name: what the value is made of
    left_out  what the formulas do not know, in words
    """

    value: float
    margins: dict[str, Margin]
    parts: dict[str, float]
    left_out: tuple[str, ...] = ()


@printed
class Judgement(NamedTuple):
    """What trials show.

    value    the objective, with its 95 % interval
    margins  by the names of limits, of the value and of both ends of its interval: value, the end
             that is nearer to the limit, the other
    parts    each criterion with its interval
    """

    value: Interval
    margins: dict[str, tuple[Margin, Margin, Margin]]
    parts: dict[str, Interval]


@printed
class Words(NamedTuple):
    """Names and units of an objective and of the criteria it is made of."""

    value: str
    unit: str
    parts: dict[str, tuple[str, str]]


@dataclass(frozen=True)
class EarthProblem:
    """The camera of a design, and the error of its retrieval.

    Trials are of images of level ground straight below, with fires of known places; of each image
    each fire is one trial.

    Raises  ValueError where the design has no retrieval or no campaign, or a name is none.
    """

    design: EarthDesign

    def __post_init__(self) -> None:
        if self.design.retrieval is None or self.design.campaign is None:
            raise Refused("a scene that is studied must have the tables [retrieval] and [campaign]")
        _ = self.conditions
        for variable in self.campaign.variables:
            number_at(self.design, variable.name)

    @property
    def campaign(self) -> EarthCampaign:
        """The question."""
        assert self.design.campaign
        return self.design.campaign

    @cached_property
    def conditions(self) -> dict[str, tuple[float, EarthDesign]]:
        """Weight and design of each condition."""
        return self.design.conditions()

    @cached_property
    def columns(self) -> np.dtype[Any]:
        """A row of one trial: numbers, named "condition: criterion"."""
        return np.dtype(
            [
                (f"{condition}: {name}", np.float64)
                for condition, (_, design) in self.conditions.items()
                for name in (*_areas(_spots(design)), POWER, TEMPERATURE, AREA)
            ]
        )

    fidelities = (IMAGE,)

    def replaced(self, values: Mapping[str, float]) -> EarthProblem:
        """The problem with other values (SI) of parameters, and what links make of them.

        Raises  ValueError with the name, where the parameter refuses the value.
        """
        changed = dict[str, float](values)
        for link in self.campaign.links:
            followed = number_at(unchecked(self.design, changed), link.to)
            ratio = followed / number_at(self.design, link.to)
            changed[link.name] = number_at(self.design, link.name) * ratio**link.power
        return EarthProblem(replaced_all(self.design, changed))

    def costs(self) -> dict[str, Margin]:
        """Margins that need neither forecast nor trial: camera, optics, what channels require."""
        limits, channels = self.campaign.requirements, self.design.camera.channels
        height, rate = flight_height(self.design.carrier), ground_rate(self.design.carrier)
        margins, each = dict[str, Margin](), []
        for channel in channels:
            air = None if channel.reference else self.design.air
            band = band_in(channel, air, height, self.design.sun_distance)
            own = figures(channel, band, height, rate)
            each.append(own)
            for name, margin in margins_of(channel, own).items():
                limit, most = known(channel.required)[name], name in ("nedt", "gsd")
                value = limit * (1 - margin if most else 1 + margin)
                margins[f"{channel.name} {name}"] = Margin(value, limit, most, UNITS.get(name, ""))
        return margins | _camera_margins(
            limits,
            limits.mass(channels),
            max(lenses_of(channels)),
            sum(own.data_rate for own in each),
            min(own.swath for own in each),
        )

    def forecast(self, conditions: Sequence[str] | None = None) -> Forecast:
        """The objective and the margins of the retrieval, by formula.

        conditions  names of those that are asked; None: all
        Raises      ValueError as `forecast_fires`.
        """
        asked = self._asked(conditions)
        parts = dict[str, float]()
        for name in asked:
            design = self.conditions[name][1]
            spots = _spots(design)
            expected = forecast_fires(design, spots)
            for criterion, area in zip(_areas(spots), expected.areas, strict=True):
                parts[f"{name}: {criterion}"] = area
            parts[f"{name}: {POWER}"] = expected.power_error
        margins = {
            name: margin for name, value in parts.items() if (margin := self._limit(name, value))
        }
        return Forecast(self._mean(parts), self.costs() | margins, parts, LEFT_OUT)

    def trials(self, seed: int, numbers: range, fidelity: str = IMAGE) -> NDArray[np.void]:
        """Rows of trials by their numbers, the same for any worker.

        Row n is fire n % k of the image n // k, of k fires; conditions have the same image.

        Raises  ValueError for another fidelity than "image", and as `views_of`.
        """
        if fidelity not in self.fidelities:
            raise Refused(f"fidelity must be {IMAGE} for an Earth camera, got {fidelity!r}")
        rows = np.zeros(len(numbers), self.columns)
        every = np.arange(numbers.start, numbers.stop, numbers.step)
        for condition, (_, design) in self.conditions.items():
            count = _spots(design).per_image
            for image in np.unique(every // count).tolist():
                mine = every // count == image
                for name, values in _trial(design, seed, image).items():
                    rows[f"{condition}: {name}"][mine] = values[every[mine] % count]
        return rows

    def judge(self, rows: NDArray[np.void]) -> Judgement:
        """The objective and the margins of rows, with 95 % intervals.

        An area is the quantile of the smallest areas of all fires, which as many are found with
        as `found` says; its interval is that of independent trials.
        """
        parts = dict[str, Interval]()
        for condition, (_, design) in self.conditions.items():
            spots = _spots(design)
            for name in _areas(spots):
                parts[f"{condition}: {name}"] = _level(rows[f"{condition}: {name}"], spots.found)
            error = rows[f"{condition}: {POWER}"]
            parts[f"{condition}: {POWER}"] = rms_interval(error**2)
        margins = {}
        for name, interval in parts.items():
            if margin := self._limit(name, interval.value):
                ends = sorted(
                    (margin._replace(value=end) for end in (interval.low, interval.high)),
                    key=lambda end: end.relative,
                )
                margins[name] = margin, ends[0], ends[1]
        value, low, high = (
            self._mean({name: getattr(interval, end) for name, interval in parts.items()})
            for end in ("value", "low", "high")
        )
        return Judgement(Interval(value, low, high), margins, parts)

    def described(self) -> str:
        """All that results depend on, for keys of stores."""
        return json.dumps([to_table(self.design), inputs_of(self.design)], sort_keys=True)

    def text(self) -> Words:
        """Names and units of the objective and its parts."""
        parts = dict[str, tuple[str, str]]()
        for condition, (_, design) in self.conditions.items():
            spots = _spots(design)
            for name, kelvin in zip(_areas(spots), spots.temperatures, strict=True):
                words = f"smallest fire of {kelvin:g} K found in {spots.found:.0%}, {condition}"
                parts[f"{condition}: {name}"] = words, "m2"
            parts[f"{condition}: {POWER}"] = f"error of radiative power, {condition}", ""
        if self.campaign.objective == "area":
            return Words("smallest fire", "m2", parts)
        return Words("error of radiative power", "", parts)

    def _asked(self, conditions: Sequence[str] | None) -> Sequence[str]:
        asked = list(self.conditions) if conditions is None else conditions
        for name in asked:
            if name not in self.conditions:
                every = ", ".join(self.conditions)
                raise Refused(f"conditions must be names of {every}, got {name!r}")
        return asked

    def _mean(self, parts: Mapping[str, float]) -> float:
        """Geometric mean of what the objective is made of, by the weights of conditions."""
        total, weights = 0.0, 0.0
        for name, value in parts.items():
            condition, _, criterion = name.partition(": ")
            if criterion.startswith("area ") != (self.campaign.objective == "area"):
                continue
            weight = self.conditions[condition][0]
            if weight:
                total += weight * (math.log(value) if value > 0 else -math.inf)
                weights += weight
        return math.exp(total / weights)

    def _limit(self, name: str, value: float) -> Margin | None:
        limits, power = self.campaign.requirements, name.endswith(f": {POWER}")
        limit = limits.max_power_error if power else limits.max_area
        return None if limit is None else Margin(value, limit, True, "" if power else "m2")


POWER, TEMPERATURE, AREA = "power", "temperature", "estimated area"
UNITS = {"nedt": "K", "saturation": "W m-2 sr-1 m-1", "gsd": "m"}
LEFT_OUT = (
    "fires that are wider than a pixel of the image",
    "errors of the registration of both channels",
)


def _spots(design: EarthDesign) -> HotSpots:
    assert design.retrieval
    assert design.retrieval.hot_spots
    return design.retrieval.hot_spots


def _areas(spots: HotSpots) -> list[str]:
    return [f"area {kelvin:g} K" for kelvin in spots.temperatures]


def _camera_margins(
    limits: CameraLimits, mass: float, aperture: float, rate: float, swath: float
) -> dict[str, Margin]:
    every = {
        "mass": (mass, limits.max_mass, True, "kg"),
        "aperture": (aperture, limits.max_aperture, True, "m"),
        "data rate": (rate, limits.max_data_rate, True, "bit / s"),
        "swath": (swath, limits.min_swath, False, "m"),
    }
    return {
        name: Margin(value, limit, most, unit)
        for name, (value, limit, most, unit) in every.items()
        if limit is not None
    }


def _level(areas: Floats, fraction: float) -> Interval:
    """The area that a fraction of trials does not exceed; inf where fires are not found."""
    interval = level_interval(np.minimum(areas, LARGEST), fraction)
    ends = (interval.value, interval.low, interval.high)
    return Interval(*(math.inf if end > LARGEST / 1e3 else end for end in ends))


@lru_cache(maxsize=4)
def _trial(design: EarthDesign, seed: int, number: int) -> dict[str, Floats]:
    """Each column (n,) of the fires of one image."""
    spots = _spots(design)
    views = hot_spots.views_of(design, spots)
    image = hot_spots.image_of(design, spots, views, seed, number)
    guesses = forecast_fires(design, spots).areas
    columns = dict[str, Floats]()
    for name, kelvin, guess in zip(_areas(spots), spots.temperatures, guesses, strict=True):
        begin = guess if 0 < guess < math.inf else views.mid.across * views.mid.along / 100
        columns[name] = hot_spots.smallest_areas(views, image, spots, kelvin, begin)
    found = hot_spots.measure(views, image, spots)
    true = fire.radiated_power(spots.temperature, spots.area)
    return columns | {
        POWER: found.power / true - 1,
        TEMPERATURE: found.temperature,
        AREA: found.area,
    }
