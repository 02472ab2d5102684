"""Case -> plans at nodes of the numbers that vary, and the plan of any unit between them."""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from startrack.core import YEAR, Curve, Floats, Refused, local_weights
from startrack.design import Case, Scope, aged, found_at, law_of, replaced
from startrack.trial import (
    FluxLimits,
    SpotPlan,
    limits_of,
    plan_within,
    refuse,
    through_of,
    view_of,
)

NODES = 9  # nodes of each number, evenly over its range; cubic between the four nearest
WIDEST = 3.5  # standard normal deviate at the ends of a range; beyond, the end counts
LOG_RANGE = 3.0  # ratio of the ends of a range, above which nodes have logarithmic steps
LOST = -50.0  # sigma relative to the threshold, for a star that is never measured
SMALL = 0.02  # relative change of the focal length, below which star images do not change
FOCAL = "instrument.optics.focal_length"
# Parameters that change only the places of stars.
PLACES = (
    *(f"instrument.optics.{name}" for name in ("principal_x", "principal_y")),
    *(f"instrument.optics.{name}" for name in ("k1", "k2", "k3", "p1", "p2")),
    *("instrument.mounting.", "instrument.residual.", "instrument.delay"),
)
TRANSMISSION = "instrument.optics.transmission"
# Parameters that change noise and detection of stars with a lens table, but not their images.
NOISE = (TRANSMISSION, "instrument.detector.read_noise", "instrument.detector.dark_current")
# Parameters that change the images of stars, except those of places and TRANSMISSION.
IMAGES = (
    "instrument.optics.",
    "instrument.thermal.",
    "instrument.detector.pixel_pitch",
    "instrument.detector.fill_factor",
    "instrument.detector.diffusion",
    "instrument.detector.quantum_efficiency",
)


class Axis(NamedTuple):
    """Nodes of one number.

    name   of the number
    nodes  (k,) of its value, or of the factor of a curve; of the logarithm of these where `log`
    """

    name: str
    nodes: Floats
    log: bool

    def weights(self, value: float) -> Floats:
        """Weights (k,) of the values at the nodes; beyond the last, those of the last."""
        at = np.log(max(value, 1e-300)) if self.log else value
        inside = np.clip(np.array([at]), self.nodes[0], self.nodes[-1])
        weight = np.zeros(len(self.nodes))
        first, four = local_weights(self.nodes, inside)
        weight[first[0] : first[0] + 4] = four[0]
        return weight

    def values(self) -> Floats:
        """Values (k,) at the nodes."""
        return np.exp(self.nodes) if self.log else self.nodes


def of_places(case: Case, name: str) -> bool:
    """Whether a number that varies changes only the places of stars."""
    if name == FOCAL:
        low, high = range_of(case, name)
        focal = case.instrument.optics.focal_length
        return max(high - focal, focal - low) <= SMALL * focal
    return name.startswith(PLACES)


@lru_cache(maxsize=8)
def share_images(case: Case) -> bool:
    """Whether a lens table gives all units the images of the design, except for their places.

    A relative change of a value that is zero in the design, such as its blur, changes nothing.
    Cached for the last 8 cases.
    """
    return case.instrument.optics.tabulated and not any(
        variation.name.startswith(IMAGES)
        and variation.name != TRANSMISSION
        and not of_places(case, variation.name)
        and not (variation.vary == "relative" and found_at(case, variation.name) == 0)
        for variation in case.varying
    )


def coordinate(case: Case, design: Case, name: str) -> float:
    """The value of a number; for a curve, its factor on the curve of the design."""
    quantity = found_at(case, name)
    if isinstance(quantity, Curve):
        return max(quantity.value) / max(found_at(design, name).value)
    return float(quantity)


def range_of(case: Case, name: str) -> tuple[float, float]:
    """Range of a number, or of the factor on a curve, over the lifetime."""
    quantity, z = found_at(case, name), np.linspace(-WIDEST, WIDEST, 29)
    start = 1.0 if isinstance(quantity, Curve) else float(quantity)
    relative = np.zeros(2)
    absolute = np.zeros(2)
    for variation in case.varying:
        if variation.name != name:
            continue
        law = law_of(case, variation)
        change = np.array([law.difference(float(at)) for at in z])
        if variation.per is Scope.LIFE:
            change = np.append(change * case.lifetime / YEAR, 0.0)
        if variation.per in (Scope.ENVIRONMENT, Scope.FRAME, Scope.LAUNCH):
            change = np.append(change, 0.0)
        ends = np.array([change.min(), change.max()])
        if variation.vary == "relative":
            relative += ends
        else:
            absolute += ends
    low, high = start * (1 + relative) + absolute
    return float(min(low, high, start)), float(max(low, high, start))


@dataclass(frozen=True, eq=False)
class UnitPlans:
    """The plan of any unit: the plan of the design plus its change by each number.

        plan = plan of the design + sum over numbers (plan at its value - plan of the design)

    Between the nodes the change by each number is a cubic polynomial. Numbers that change only
    places change the camera instead; each unit has its own camera.

    case    the design
    limits  the stars of all plans
    plan    of the design
    parts   arrays of the plan that change
    axes    numbers that change them
    change  of each axis: (k, ...) differences of each part from that of the design
    last    cache of the last plan, by the unit's values of the axes
    """

    case: Case
    limits: FluxLimits
    plan: SpotPlan
    parts: list[Floats]
    axes: list[Axis]
    change: list[list[Floats]]
    last: dict[tuple[float, ...], SpotPlan] = field(default_factory=dict)

    def of(self, unit: Case) -> SpotPlan:
        """The plan of a unit of this design.

        Accuracy  the rms error of a unit agrees with that by its exact plan within 3 %.
        """
        at = tuple(coordinate(unit, self.case, axis.name) for axis in self.axes)
        if at not in self.last:  # mostly equal from environment to environment
            parts = self.parts
            for axis, value, change in zip(self.axes, at, self.change, strict=True):
                weight = axis.weights(value)
                parts = [
                    old + np.tensordot(weight, by, 1) for old, by in zip(parts, change, strict=True)
                ]
            self.last.clear()
            self.last[at] = _with(self.plan, parts)
        camera = unit.instrument.camera
        view = view_of(camera, self.plan.view.border)
        return self.last[at]._replace(view=view, through=through_of(unit))


def unit_plans(case: Case, age: float = 0.0) -> UnitPlans:
    """Measure stars of a design at the nodes of all numbers that vary; cached for the last 2.

    age     second, of the detector if it has an ageing law
    Raises  ValueError if fidelity covariance cannot compute the design, or a number.
    """
    return _unit_plans(case, age if case.instrument.detector.age else 0.0)


@lru_cache(maxsize=2)
def _unit_plans(case: Case, age: float) -> UnitPlans:
    bare = aged(case.without_units, age)
    refuse(bare)
    names = list(dict.fromkeys(variation.name for variation in case.varying))
    for name in names:
        if name.startswith("catalog."):
            raise Refused(f"{name} must not vary in fidelity covariance; choose frame or window")
    axes = [_axis(case, name) for name in names if not of_places(case, name)]
    unit = bare.unit_of(case)  # equal to the design
    cases = [[_at(case, bare, axis.name, value) for value in axis.values()] for axis in axes]
    faintest, brightest, stars = zip(*map(limits_of, sum(cases, [unit])), strict=True)
    limits = FluxLimits(min(faintest), max(brightest), max(stars, key=len))
    plan = plan_within(unit, limits)
    parts, change = _parts(plan), []
    for axis, row in zip(axes, cases, strict=True):
        nodes = [_parts(plan_within(node, limits)) for node in row]
        stacked = [np.stack(arrays) for arrays in zip(*nodes, strict=True)]
        weight = axis.weights(coordinate(case, case, axis.name))
        change.append([values - np.tensordot(weight, values, 1) for values in stacked])
    return UnitPlans(case, limits, plan, parts, axes, change)


def _axis(case: Case, name: str) -> Axis:
    low, high = range_of(case, name)
    if not low < high:
        high = low + max(abs(low), 1.0) * 1e-6
    log = low > 0 and high > LOG_RANGE * low
    if log:
        low, high = np.log(low), np.log(high)
    return Axis(name, np.linspace(low, high, NODES), log)


def _at(case: Case, bare: Case, name: str, value: float) -> Case:
    """A unit of the case with another true value of a number, or another factor on a curve."""
    old: Any = found_at(case, name)
    new: Any = float(value)
    if isinstance(old, Curve):
        new = old.scaled(float(value))
    return replaced(bare, name, new).unit_of(case)


def _parts(plan: SpotPlan) -> list[Floats]:
    """The arrays of a plan that change from unit to unit, on additive scales."""
    _, bias, root, light, above, kept, least = plan.response
    return [
        plan.field.flux,
        bias,
        root,
        light,
        np.maximum(above, LOST),
        kept,
        np.nan_to_num(least),
        np.nan_to_num(plan.pull),
        np.log(np.array([plan.false + 1e-12])),
    ]


def _with(plan: SpotPlan, parts: list[Floats]) -> SpotPlan:
    """A plan with other arrays."""
    flux, bias, root, light, above, kept, least, pull, false = parts
    old = plan.response
    response = old._replace(
        bias=bias,
        covariance_root=np.where(old.covariance_root != 0, root, 0.0),
        light=np.maximum(light, 0.0),
        threshold_margin=above,
        pass_probability=np.clip(kept, 0.0, 1.0),
        star_at_threshold=np.where(np.isnan(old.star_at_threshold), np.nan, least),
    )
    brighter = float((flux - plan.field.flux).mean())
    return plan._replace(
        response=response,
        pull=np.where(np.isnan(plan.pull), np.nan, pull),
        field=plan.field._replace(flux=flux),
        companions=plan.companions._replace(flux=plan.companions.flux + brighter),
        false=float(np.exp(false[0])),
    )
