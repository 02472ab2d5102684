"""EarthProblem: an Earth camera as a problem for searches, samples and tests of requirements.

A problem has parameters by name, costs, a forecast by formula, numbered trials, and a judgement of
the trials' rows. It describes its values in words.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from startrack.core import Floats, Refused, Rows, inputs_of
from startrack.design import bounds_of, followed, number_at, replaced_all
from startrack.earth.geometry import flight_height, ground_rate
from startrack.earth.imager import figures, known, margins_of
from startrack.earth.retrieval.criteria import Criterion, RetrievalStudy, study_of
from startrack.earth.retrieval.fire_forecast import band_in
from startrack.earth.retrieval.study import OWN, CameraLimits, EarthCampaign, EarthDesign, lenses_of
from startrack.io import to_table
from startrack.metrics import Interval
from startrack.problem import Bounds, Expectation, Judgement, Margin, TrialView, Words

IMAGE = "image"


@dataclass(frozen=True)
class EarthProblem:
    """The camera of a design, and the error of its retrieval.

    Trials use images of level ground straight below: fires at known places, spectra of known
    minerals, fields of known covers, known terrain, or known waves. Each fire, each spectrum, and
    each image of fields, terrain or waves is one trial.

    Raises  ValueError if the design has no retrieval or no campaign, or a name is unknown.
    """

    design: EarthDesign

    def __post_init__(self) -> None:
        if self.design.retrieval is None or self.design.campaign is None:
            raise Refused("a scene must have the tables [retrieval] and [campaign] for a study")
        _ = self.conditions
        if not self._objective():
            raise Refused(
                f"campaign.objective must be an objective of this retrieval, "
                f"{', '.join(dict.fromkeys(kind for kind in self._kinds()))}, got "
                f"{self.campaign.objective!r}"
            )
        for variable in self.campaign.variables:
            number_at(self.design, variable.name)

    def _kinds(self) -> list[str]:
        every = (study.criteria.values() for study in self.studies.values())
        return [criterion.objective for criteria in every for criterion in criteria]

    @property
    def campaign(self) -> EarthCampaign:
        """The campaign of the design."""
        assert self.design.campaign
        return self.design.campaign

    @cached_property
    def conditions(self) -> dict[str, tuple[float, EarthDesign]]:
        """Weight and design of each condition."""
        return self.design.conditions()

    @cached_property
    def studies(self) -> dict[str, RetrievalStudy]:
        """The retrieval of each condition."""
        return {name: study_of(design) for name, (_, design) in self.conditions.items()}

    @cached_property
    def columns(self) -> np.dtype[Any]:
        """Names of the numbers of a trial's row: "condition: column"."""
        return np.dtype(
            [
                (f"{condition}: {name}", np.float64)
                for condition, study in self.studies.items()
                for name in study.columns
            ]
        )

    fidelities = (IMAGE,)

    @property
    def per_image(self) -> int:
        """Trials of an image, at most over the conditions."""
        return max(study.per_image for study in self.studies.values())

    def replaced(self, values: Mapping[str, float]) -> EarthProblem:
        """The problem with other values (SI) of parameters and of the parameters linked to them.

        Raises  ValueError with the name, where a value is not allowed.
        """
        changed = followed(self.design, values, self.campaign.links)
        return EarthProblem(replaced_all(self.design, changed))

    def costs(self) -> dict[str, Margin]:
        """Margins that need neither forecast nor trial: camera, optics, requirements of
        channels."""
        limits, channels = self.campaign.requirements, self.design.camera.channels
        height, rate = flight_height(self.design.carrier), ground_rate(self.design.carrier)
        margins, each = dict[str, Margin](), []
        for channel in channels:
            air = None if channel.reference else self.design.air
            band = band_in(channel, air, height, self.design.distance_to_sun)
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

    @property
    def settings(self) -> EarthCampaign:
        """Settings of the search."""
        return self.campaign

    @cached_property
    def variables(self) -> list[Bounds]:
        """Variables of a search."""
        return bounds_of(self.design, self.campaign.variables)

    def expect(self, conditions: Sequence[str] | None = None) -> Expectation:
        """The objective and the margins of the retrieval, by formula.

        conditions  names of the wanted conditions; None: all
        Raises      ValueError as `forecast_fires`.
        """
        parts = {
            f"{condition}: {name}": value
            for condition in self._asked(conditions)
            for name, value in self.studies[condition].expected().items()
        }
        limits = {name: self._limit(name, value) for name, value in parts.items()}
        margins = {name: margin for name, margin in limits.items() if margin}
        left_out = (
            *next(iter(self.studies.values())).left_out,
            *(
                f"formulas alone: the read-out channel of {channel.name} (settling, "
                "impulse_response)"
                for channel in self.design.camera.channels
                if channel.detector.settling or channel.detector.impulse_response
            ),
            *(
                f"formulas and trials: the Wiener filter of {channel.name} (restore); the "
                "retrieval uses images as recorded"
                for channel in self.design.camera.channels
                if channel.restore is not None
            ),
            *self._fixed_sun(),
        )
        return Expectation(self._mean(parts), margins, parts, left_out)

    def _fixed_sun(self) -> tuple[str, ...]:
        orbit, retrieval = self.design.orbit, self.design.retrieval
        if orbit is None or orbit.local_time is None or retrieval is None:
            return ()
        if retrieval.latitude is not None:
            return ()
        return (
            "the Sun of orbit.local_time: without retrieval.latitude, sun_zenith places the Sun",
        )

    def trials(self, seed: int, numbers: range, fidelity: str = IMAGE) -> Rows:
        """Rows of trials by their numbers, the same for any worker.

        An image has k trials: row n is trial n % k of the image n // k. Conditions use the same
        images.

        Raises  ValueError for a fidelity other than "image", and as `views_of`.
        """
        if fidelity not in self.fidelities:
            raise Refused(f"fidelity must be {IMAGE} for an Earth camera, got {fidelity!r}")
        rows = np.zeros(len(numbers), self.columns)
        every = np.arange(numbers.start, numbers.stop, numbers.step)
        for condition, study in self.studies.items():
            count = study.per_image
            for image in np.unique(every // count).tolist():
                mine = every // count == image
                for name, values in _image(self.conditions[condition][1], seed, image).items():
                    rows[f"{condition}: {name}"][mine] = values[every[mine] % count]
        return rows

    def view(self, seed: int, number: int, condition: str = OWN) -> TrialView:
        """Images of a trial in a condition, from the same functions as its row.

        Raises  ValueError if there is no such condition, and as `trials`.
        """
        (name,) = self._asked([condition])
        study = self.studies[name]
        image, trial = divmod(number, study.per_image)
        return study.view(seed, image, trial)

    def judge(self, rows: Rows, confidence: float = 0.95) -> Judgement:
        """The objective and the margins of rows, with confidence intervals."""
        parts = {
            f"{condition}: {name}": study.shown(
                name, rows[f"{condition}: {criterion.column}"], confidence
            )
            for condition, study in self.studies.items()
            for name, criterion in study.criteria.items()
        }
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
        """All inputs of the results, for keys of stores."""
        return json.dumps([to_table(self.design), inputs_of(self.design)], sort_keys=True)

    def text(self) -> Words:
        """Names and units of the objective and its parts."""
        parts = {
            f"{condition}: {name}": (f"{criterion.words}, {condition}", criterion.unit)
            for condition, study in self.studies.items()
            for name, criterion in study.criteria.items()
        }
        first = next(iter(self._objective().values()))
        return Words(OBJECTIVES[self.campaign.objective], first.unit, parts)

    def _objective(self) -> dict[str, Criterion]:
        """Parts of the objective."""
        return {
            f"{condition}: {name}": criterion
            for condition, study in self.studies.items()
            for name, criterion in study.criteria.items()
            if criterion.objective == self.campaign.objective
        }

    def _asked(self, conditions: Sequence[str] | None) -> Sequence[str]:
        asked = list(self.conditions) if conditions is None else conditions
        for name in asked:
            if name not in self.conditions:
                every = ", ".join(self.conditions)
                raise Refused(f"conditions must be names of {every}, got {name!r}")
        return asked

    def _mean(self, parts: Mapping[str, float]) -> float:
        """Geometric mean of the parts of the objective, with the weights of conditions."""
        total, weights = 0.0, 0.0
        for name in self._objective():
            weight = self.conditions[name.partition(": ")[0]][0]
            if weight and name in parts:
                value = parts[name]
                total += weight * (math.log(value) if value > 0 else -math.inf)
                weights += weight
        return math.exp(total / weights) if weights else math.nan

    def _limit(self, name: str, value: float) -> Margin | None:
        condition, _, criterion = name.partition(": ")
        about = self.studies[condition].criteria[criterion]
        limit = getattr(self.campaign.requirements, about.limit)
        return None if limit is None else Margin(value, limit, most=True, unit=about.unit)


OBJECTIVES = {
    "area": "smallest fire",
    "power": "error of the radiative power",
    "emissivity": "error of emissivity",
    "reflectance": "error of reflectance",
    "index": "error of the index",
    "wrong": "fraction classified wrongly",
    "height": "error of heights",
    "wave height": "error of wave height",
    "wave direction": "error of the waves' direction",
}
UNITS = {"nedt": "K", "saturation": "W m-2 sr-1 m-1", "gsd": "m"}


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


@lru_cache(maxsize=4)
def _image(design: EarthDesign, seed: int, number: int) -> dict[str, Floats]:
    """Values (n,) of each column, for the trials of one image."""
    return study_of(design).image(seed, number)
