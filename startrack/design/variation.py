"""Variation: differences of a true value between units, environments and in time."""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from startrack import core
from startrack.core import FINITE, NON_NEGATIVE, YEAR, Parameters, Range, Refused, parameter
from startrack.design.parameter import find, replaced_all, unchecked, unit_at

LAWS = ("normal", "truncated", "uniform", "lognormal", "sinusoid", "table")
ABSOLUTE, RELATIVE = "absolute", "relative"
TRUTH = ("instrument.", "scene.", "catalog.")

QUANTILES = 400  # quantiles for the mean square of a law; for a normal law the error is 0.4 %


class Scope(StrEnum):
    """Scope of a variation: between what a number differs.

    unit         from unit to unit, as built
    launch       by one step of each unit, at launch
    environment  over orbits and seasons: temperature and dependent values
    life         by a constant drift of each unit, per year
    frame        from frame to frame
    """

    UNIT = "unit"
    LAUNCH = "launch"
    ENVIRONMENT = "environment"
    LIFE = "life"
    FRAME = "frame"


DIFFERENCE = (
    "difference from the design, with a unit if it is absolute and the number has one; for "
    "scope life, per year"
)


class Variation(Parameters):
    """Random variation of one true value; the tracker does not know the difference.

        value = design (1 + sum of relative differences) + sum of absolute differences

    z is a standard normal number, and u = Phi(z) the corresponding uniform number. The difference d
    is

        normal     mean + sigma z
        truncated  as normal, given that low <= d <= high
        uniform    low + (high - low) u
        lognormal  exp(mean + sigma z) - 1, relative
        sinusoid   mean + amplitude sin(2 pi u + phase): at a random time of an orbit or a season
        table      between `values` evenly spaced over u: quantiles if they rise, else the profile
                   over a period
    """

    name: str = parameter(
        'dotted name of a true value: "instrument.optics.focal_length"; all values of a curve over '
        "wavelength change by the same relative difference"
    )
    law: str = parameter("see above", limit=Range(choices=LAWS), default="normal")
    sigma: float | str = parameter(DIFFERENCE, default=0.0)
    low: float | str = parameter(DIFFERENCE, default=0.0)
    high: float | str = parameter(DIFFERENCE, default=0.0)
    mean: float | str = parameter(DIFFERENCE, default=0.0)
    amplitude: float | str = parameter(DIFFERENCE, default=0.0)
    values: tuple[float | str, ...] = parameter(
        "differences of the law table, with a unit as above", default=()
    )
    phase: float = parameter(
        "phase of a sinusoid in periods, ahead of others of its group", limit=FINITE, default=0.0
    )
    vary: str = parameter(
        '"absolute" or "relative" difference',
        limit=Range(choices=(ABSOLUTE, RELATIVE)),
        default=ABSOLUTE,
    )
    per: Scope = parameter("unit, launch, environment, life or frame", default=Scope.UNIT)
    group: str = parameter(
        'variations of one group and scope share their z; "": no group', default=""
    )
    correlation: float = parameter(
        "correlation with the z of its group; a sinusoid has the phase of its group",
        limit=Range(-1, 1),
        default=1.0,
    )
    scale: float = parameter(
        "factor on all differences from the mean: a tolerance. It may be a variable of a campaign, "
        'such as "variation.0.scale"',
        limit=NON_NEGATIVE,
        default=1.0,
    )
    price: float = parameter(
        "cost of halving `scale` from 1, in the unit of the requirements' cost; each further "
        "halving costs the same, and doubling it saves the same",
        limit=NON_NEGATIVE,
        default=0.0,
    )
    source: str = parameter("source of the numbers; it has no effect", default="")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.price and not self.scale:
            raise Refused("scale must be positive if a price is given, got 0")
        if not self.name.startswith(TRUTH):
            raise Refused(
                "name must begin with instrument., scene. or catalog.: only true values vary, "
                f"got {self.name!r}"
            )
        if self.law == "lognormal" and self.vary != RELATIVE:
            raise Refused('vary must be "relative" for law lognormal, got "absolute"')
        if (len(self.values) >= 2) != (self.law == "table"):
            raise Refused(
                f"values must be two or more for law table, none for others, got {len(self.values)}"
            )
        if self.correlation != 1 and not self.group:
            raise Refused("correlation must be left out without a group")

    @property
    def cost(self) -> float:
        """Cost of the tolerance above the cost at scale 1: price log2(1 / scale)."""
        return -self.price * math.log2(self.scale) if self.price else 0.0

    @property
    def stream(self) -> str:
        """Name of the random stream of its independent z."""
        return f"variation of {self.name} per {self.per}"

    @property
    def group_stream(self) -> str:
        """Name of the random stream of the z of its group."""
        return f"variations of group {self.group} per {self.per}" if self.group else self.stream


@dataclass(frozen=True)
class Law:
    """A variation in SI units.

    variation  variation whose texts have been converted
    """

    variation: Variation
    sigma: float
    low: float
    high: float
    mean: float
    amplitude: float
    values: tuple[float, ...]

    def difference(self, z: float) -> float:
        """The difference from the design for a standard normal number."""
        given = self.variation
        match given.law:
            case "normal":
                return self.mean + given.scale * self.sigma * z
            case "truncated":
                low, high = (ndtr((end - self.mean) / self.sigma) for end in (self.low, self.high))
                between = float(ndtri(low + (high - low) * ndtr(z)))
                return self.mean + given.scale * self.sigma * between
            case "uniform":
                middle = (self.low + self.high) / 2
                return middle + given.scale * (self.high - self.low) * (float(ndtr(z)) - 0.5)
            case "lognormal":
                return math.expm1(self.mean + given.scale * self.sigma * z)
            case "sinusoid":
                turn = 2 * math.pi * (float(ndtr(z)) + given.phase)
                return self.mean + given.scale * self.amplitude * math.sin(turn)
        place = np.linspace(0, 1, len(self.values))
        return self.mean + given.scale * float(np.interp(ndtr(z), place, self.values))

    def mean_square(self) -> float:
        """Mean square of the difference, by the midpoint rule in QUANTILES parts."""
        u = (np.arange(QUANTILES) + 0.5) / QUANTILES
        return float(np.mean([self.difference(float(z)) ** 2 for z in ndtri(u)]))


def law_of(case: Any, variation: Variation) -> Law:
    """The variation in the units of its parameter.

    Raises  ValueError if the case has no such number, or a value has the wrong unit or size.
    """
    now = find(case, variation.name)
    curve = isinstance(now, core.Curve)
    if isinstance(now, bool) or not (curve or isinstance(now, int | float)):
        raise Refused(f"{variation.name} must be a number or a curve to vary, got {now!r}")
    if curve and variation.vary != RELATIVE:
        raise Refused(f'{variation.name}: vary must be "relative" for a curve')

    relative = curve or variation.vary != ABSOLUTE
    unit = None if relative else unit_at(case, variation.name)

    def si(key: str, value: float | str) -> float:
        if isinstance(value, str):
            if unit is None:
                raise Refused(
                    f"{variation.name}: {key} must be a number without unit, got {value!r}"
                )
            try:
                return core.parse(value, unit.si)
            except Refused as error:
                raise Refused(f"{variation.name}: {key} {error}") from None
        if unit is not None and value:
            raise Refused(
                f"{variation.name}: {key} must have a unit, such as '1 {unit.shown}', got {value:g}"
            )
        core.finite(**{key: value})
        return float(value)

    sigma, low, high, mean, amplitude = (
        si(key, getattr(variation, key)) for key in ("sigma", "low", "high", "mean", "amplitude")
    )
    values = tuple(si("values", entry) for entry in variation.values)
    if sigma < 0 or (variation.law == "truncated" and not sigma > 0):
        raise Refused(f"{variation.name}: sigma must be positive, got {variation.sigma}")
    if variation.law in ("uniform", "truncated") and not low < high:
        raise Refused(
            f"{variation.name}: low must be below high, got {variation.low} and {variation.high}"
        )
    return Law(
        variation=variation,
        sigma=sigma,
        low=low,
        high=high,
        mean=mean,
        amplitude=amplitude,
        values=values,
    )


def check_variations(case: Any, variations: tuple[Variation, ...]) -> None:
    """Refuse variations that cannot be drawn, or are given twice.

    Raises  ValueError that names the variation.
    """
    streams = set[str]()
    for variation in variations:
        law_of(case, variation)
        if variation.stream in streams:
            raise Refused(f"variation of {variation.name} must be given once per {variation.per}")
        streams.add(variation.stream)


@dataclass(frozen=True)
class Moment:
    """One draw of all that varies: a unit, its environment, frame and age.

    unit         number of the unit; -1: nothing varies
    environment  number of the environment; -1: the environment of the calibration
    frame        number of the frame in this environment; -1: none
    age          second, since launch
    launched     whether the steps at launch have happened
    """

    unit: int
    environment: int = -1
    frame: int = -1
    age: float = 0.0
    launched: bool = True


def differences(case: Any, seed: int, moment: Moment) -> list[tuple[Variation, float]]:
    """The difference of each variation of a case from the design, SI units.

    Each difference is drawn from random streams that depend only on seed, unit and names.
    """
    drawn = []
    for variation, law in zip(case.varying, case.laws, strict=True):
        instance = _instance(variation.per, moment)
        if instance is None:
            continue
        z = _normal(seed, moment.unit, variation.group_stream + instance)
        if variation.group and variation.correlation != 1 and variation.law != "sinusoid":
            independent = _normal(seed, moment.unit, variation.stream + instance)
            z = variation.correlation * z + math.sqrt(1 - variation.correlation**2) * independent
        difference = law.difference(z)
        if variation.per is Scope.LIFE:  # per year
            difference = difference * moment.age / YEAR
        drawn.append((variation, difference))
    return drawn


@lru_cache(maxsize=2**14)
def _normal(seed: int, unit: int, stream: str) -> float:
    """A standard normal number of a unit; cached, because all designs have the same units."""
    return float(core.Streams(seed, unit)(stream).standard_normal())


def _instance(scope: Scope, moment: Moment) -> str | None:
    """End of a stream's name; None if the scope does not apply."""
    match scope:
        case Scope.LAUNCH if not moment.launched:
            return None
        case Scope.LIFE if not moment.age:
            return None
        case Scope.ENVIRONMENT:
            return None if moment.environment < 0 else f" {moment.environment}"
        case Scope.FRAME:
            return None if moment.frame < 0 else f" {moment.environment} {moment.frame}"
    return ""


def unit_case(case: Any, seed: int, moment: Moment) -> Any:
    """The case of a unit: its true values are drawn, its assumed values are those of the design.

    A detector with an ageing law (`detector.age`) has the age of the unit. A dark map for which the
    tracker states no age is also made at this age.

    Raises  ValueError with the unit and the name if a drawn value is not allowed.
    """
    bare = case.without_units
    if moment.unit < 0:
        return bare
    bare = aged(bare, moment.age)
    values = unit_values(case, seed, moment)
    design = case
    # The unit has its own pixel maps and residual; its dark map is made with its own pixels.
    device = int(core.Streams(seed, moment.unit)("device of a unit").integers(2**62))
    if case.tracker.detection.dark_map is not None:
        design = unchecked(design, {"instrument.detector.device_seed": device})
    values["instrument.detector.device_seed"] = device
    try:
        truth = replaced_all(bare, values)
    except Refused as error:
        raise Refused(f"unit {moment.unit} of seed {seed}: {error}") from None
    return truth.unit_of(design)


def unit_values(
    case: Any, seed: int, moment: Moment, names: Collection[str] | None = None
) -> dict[str, Any]:
    """The numbers of a unit that differ from those of the design, by name.

    names  of the numbers among which they are; None: all
    """
    drawn = differences(case, seed, moment)
    if names is not None:
        drawn = [pair for pair in drawn if pair[0].name in names]
    values = _values(case, drawn)
    if case.instrument.residual is not None:
        values["instrument.residual.seed"] = _residual_seed(seed, moment.unit)
    return values


@lru_cache(maxsize=2**10)
def _residual_seed(seed: int, unit: int) -> int:
    return int(core.Streams(seed, unit)("residual of a unit").integers(2**62))


def middle_case(case: Any, age: float, names: Collection[str]) -> Any:
    """A unit in which some numbers are those of the middle unit, and all others as designed.

    age    second
    names  names of the numbers with the difference for z = 0, as built and by age
    """
    drawn = [
        (variation, law.difference(0.0) * (age / YEAR if variation.per is Scope.LIFE else 1.0))
        for variation, law in zip(case.varying, case.laws, strict=True)
        if variation.name in names and variation.per in (Scope.UNIT, Scope.LIFE)
    ]
    bare = case.without_units
    return replaced_all(aged(bare, age), _values(case, drawn)).unit_of(case)


def _values(case: Any, drawn: list[tuple[Variation, float]]) -> dict[str, Any]:
    """The numbers of a design with their differences, by name."""
    relative, absolute = dict[str, float](), dict[str, float]()
    for variation, difference in drawn:
        sums = relative if variation.vary == RELATIVE else absolute
        sums[variation.name] = sums.get(variation.name, 0.0) + difference
    values = dict[str, Any]()
    for name in relative.keys() | absolute.keys():
        designed = find(case, name)
        if isinstance(designed, core.Curve):
            values[name] = designed.scaled(1 + relative[name])
        else:
            values[name] = designed * (1 + relative.get(name, 0.0)) + absolute.get(name, 0.0)
    return values


def aged(case: Any, age: float) -> Any:
    """A case whose detector, if it has an ageing law, is `age` seconds in orbit.

    A dark map that would be made later, or whose age is left out, is made at this age.
    """
    detector, detection = case.instrument.detector, case.tracker.detection
    if not detector.age:
        return case
    older = replace(detector, age=replace(detector.age, time=age, year=None, launch=None))
    if detection.dark_map is not None:
        map_age = detection.dark_map_age
        detection = replace(detection, dark_map_age=age if map_age is None else min(map_age, age))
    instrument = replace(case.instrument, detector=older)
    return replace(case, instrument=instrument, tracker=replace(case.tracker, detection=detection))
