"""Case, units -> gain of each tolerance and each lever of a design, by budgets of its units."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from startrack import design
from startrack.budget import unit_budgets
from startrack.core import Advance, Floats, Refused, printed
from startrack.metrics import Interval, quantile_of_few, resampled_interval
from startrack.optimise.units import resampled_units
from startrack.verification import units_expected

ENVIRONMENTS = 2  # environments of each unit; by hand: time against the error of a unit's rms
BOOTSTRAP = 4  # names the stream of the resampling


@printed
class LeverChange(NamedTuple):
    """A design with one change.

    name   name of the changed value
    text   the values before and after; "" for a tolerance, which is halved
    price  cost of halving a tolerance, in the unit of the requirements' cost
    """

    name: str
    case: design.Case
    text: str = ""
    price: float = 0.0


@dataclass(frozen=True)
class LeverGain:
    """Gain of one change of the design.

    change  the change, with the changed design
    level   radian, decrease of the level over units, with its interval
    yields  1, increase of the yield of each limit, with its interval
    """

    change: LeverChange
    level: Interval
    yields: tuple[Interval, ...]


@dataclass(frozen=True)
class Allocation:
    """Changes of a design, the largest gain first.

    age       second, age of the units
    fraction  1, fraction of the units that does not exceed the level
    level     radian, level of the objective
    yields    1, yield of each limit
    gains     gain of each change
    refused   changes that the design refuses, and why
    """

    age: float
    fraction: float
    level: float
    yields: tuple[float, ...]
    gains: tuple[LeverGain, ...]
    refused: tuple[str, ...] = ()


def allocation(
    case: design.Case,
    objective: design.Objective,
    limits: Sequence[design.Accuracy],
    fraction: float,
    seed: int,
    count: int,
    changes: Sequence[LeverChange],
    progress: Advance | None = None,
) -> Allocation:
    """Gains of each change alone, on the same draws of the same units.

    The units are at the end of life. Intervals are by a bootstrap over the units: from
    `resampled_interval` for the level, percentiles for the yields. The units are the same before
    and after a change, so that differences that all have in common do not widen the intervals.

    fraction  1, fraction of the units that must not exceed the level
    progress  called with 1 for each unit
    Accuracy  model: that of the budget; gains of two tolerances do not add if one hides the other.
    """
    age = case.end_of_life
    asked = [objective, *(limit.objective for limit in limits)]

    def errors(case: design.Case) -> list[Floats]:
        units = unit_budgets(case, seed, count, age, ENVIRONMENTS, progress=progress, apart=False)
        return [units_expected(goal, units) for goal in asked]

    chosen = resampled_units(count, seed, BOOTSTRAP)
    before = errors(case)
    level = quantile_of_few(before[0][chosen], fraction)
    kept = [values <= limit.most for values, limit in zip(before[1:], limits, strict=True)]
    gains, refused = list[LeverGain](), list[str]()
    for change in changes:
        try:
            after = errors(change.case)
        except Refused as error:
            refused.append(f"{change.name} {change.text}: {error}")
            continue
        gained = level - quantile_of_few(after[0][chosen], fraction)
        more = [
            ((values <= limit.most) * 1.0 - was)[chosen].mean(axis=1)
            for values, limit, was in zip(after[1:], limits, kept, strict=True)
        ]
        freedom = 2 * count * (1 - fraction) + 1  # units are few, and the same before and after
        rises = (_percentiles(share) for share in more)
        gains.append(LeverGain(change, resampled_interval(gained, max(freedom, 2.0)), tuple(rises)))
    gains.sort(key=lambda gain: -gain.level.value)
    shares = tuple(float(flags.mean()) for flags in kept)
    return Allocation(age, fraction, float(level[0]), shares, tuple(gains), tuple(refused))


def _percentiles(values: Floats) -> Interval:
    """The first value, with the interval that contains 95 % of the others."""
    low, high = np.quantile(values[1:], [0.025, 0.975])
    return Interval(float(values[0]), float(low), float(high))


def halved(case: design.Case) -> Iterator[LeverChange]:
    """Each tolerance of a design, and the parts of its residual, halved."""
    for number, variation in enumerate(case.variation):
        half = replace(variation, scale=variation.scale / 2)
        every = (*case.variation[:number], half, *case.variation[number + 1 :])
        half_case = replace(case, variation=every)
        yield LeverChange(f"{variation.name} per {variation.per}", half_case, price=variation.price)
    for name in PARTS if case.instrument.residual is not None else ():
        path = f"instrument.residual.{name}"
        if now := design.found_at(case, path):
            yield LeverChange(path, design.replaced_all(case, {path: now / 2}))


PARTS = ("rms", "angle", "grid", "flatness", "decentre", "tilt", "wedge", "drift")
# Factors for numbers of a design, if it has them: possible steps of a maker.
STEPS = {
    "tracker.detection.max_spots": 1.5,
    "tracker.calibration.positions": 2.0,
    "tracker.calibration.frames": 2.0,
    "tracker.calibration.noise": 0.5,
    "tracker.calibration.direction": 0.5,
    "instrument.optics.focal_length": 1.1,
    "instrument.optics.f_number": 1 / 1.2,
    "instrument.detector.exposure": 1.5,
}
STIFFER = {"aluminium": "titanium", "titanium": "invar", "invar": "carbon"}
FEET, THIN = "instrument.structure.feet_thickness", 2e-3  # metre: thin feet follow the panel
HALVED = {"gradient": ("_x", "_y"), "detector_offset": ("",)}  # keys of a structure
WATT = 0.5  # watt, power of a heater
DEEPER = 0.5  # magnitude, step of the depth of the catalogue
HIGHEST, FIRST_MAP, FINEST_MAP = 7, 5, 9  # order of a polynomial; nodes along a side of a map


def levers(case: design.Case) -> Iterator[LeverChange]:
    """Changes that a designer can make in addition to tolerances, each by a step (`STEPS`).

    They are changes of number of tracked stars, catalogue, calibration, causes of the residual,
    structure, colour, lens and exposure. Values that the design does not have, or that are at their
    bound, are left out.
    """
    for name, value in _wanted(case).items():
        now = design.found_at(case, name)
        if now == value or value is None:
            continue
        if isinstance(value, str):
            thin = {FEET: THIN} if design.found_at(case, FEET) > THIN else {}
            changed = design.replaced_all(case, {name: value, **thin})
            yield LeverChange(name, changed, f"to {value} from {now}" + ", thin feet" * bool(thin))
            continue
        new, old = (design.value_text(case, name, number) for number in (value, now))
        text = "on" if value is True else f"to {new} from {old}"
        yield LeverChange(name, design.replaced_all(case, {name: value}), text)
    for change in halved(case):
        if ".residual." in change.name:
            yield change._replace(text="halved")
    for key, ends in HALVED.items() if case.instrument.structure is not None else ():
        name = f"instrument.structure.{key}"
        less = {f"{name}{end}": _value(case, f"{name}{end}") / 2 for end in ends}
        if any(less.values()):
            yield LeverChange(
                f"{name}{' and '.join(ends)}", design.replaced_all(case, less), "halved"
            )


def _wanted(case: design.Case) -> dict[str, Any]:
    """Better values of keys, each a step from the design's; some may be equal to it."""
    wanted = dict[str, Any]()
    for name, factor in STEPS.items():
        now = _value(case, name)
        # Images in a file are for a single lens.
        if now and not (case.instrument.optics.psf_file and name in design.OF_IMAGES):
            wanted[name] = round(now * factor) if isinstance(now, int) else now * factor
    listed, calibration = case.tracker.catalog, case.tracker.calibration
    if listed is not None and listed.limit_g + DEEPER <= case.catalog.limit_g:
        wanted["tracker.catalog.limit_g"] = listed.limit_g + DEEPER
    if calibration is not None:
        wanted["tracker.calibration.order"] = min(calibration.order + 2, HIGHEST)
        wanted["tracker.calibration.tangential"] = True
        finer = min(calibration.map + 2, FINEST_MAP) if calibration.map else FIRST_MAP
        wanted["tracker.calibration.map"] = finer
        unused = "frames" if calibration.place == "ground" else "positions"
        wanted.pop(f"tracker.calibration.{unused}", None)
    structure = case.instrument.structure
    if structure is not None:
        wanted["instrument.structure.material"] = STIFFER.get(structure.material)
        wanted["instrument.structure.heater"] = structure.heater + WATT
    if case.instrument.optics.tabulated:
        wanted["tracker.focal_length_by_colour"] = True
    return wanted


def _value(case: design.Case, name: str) -> Any:
    """A number of a case; None if the case does not have it."""
    part: Any = case
    for step in name.split("."):
        part = getattr(part, step, None)
    return part
