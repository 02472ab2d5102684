"""Variable, Link, DesignSpace, Choice: the parameters of a case that a campaign may change."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from startrack.core import FINITE, Flags, Floats, Parameters, Range, Refused, parameter, printed
from startrack.design.case import Case
from startrack.design.parameter import (
    find,
    number,
    quantity,
    replaced_all,
    text,
    unchecked,
    unit_at,
    with_values,
)
from startrack.design.parameter import label as parameter_label
from startrack.design.products import DETECTOR, KEPT, OPERATED, with_product
from startrack.io import from_table, to_table
from startrack.problem import Bounds


class Variable(Parameters):
    """One parameter that may change."""

    name: str = parameter(
        'path in the case, such as "instrument.optics.focal_length"; in a list by number, such '
        'as "instrument.motion.tones.0.rms_x". A whole number is rounded'
    )
    low: float | str = parameter("lower bound, with a unit if the parameter has one")
    high: float | str = parameter("upper bound, with a unit if the parameter has one")
    scale: str = parameter(
        '"linear" or "log": scale on which the search steps through the range',
        limit=Range(choices=("linear", "log")),
        default="linear",
    )


class Link(Parameters):
    """One parameter that follows another, from their values in the design.

        value = value_0 (to / to_0)^power

    The index 0 means the value in the design as it is read.
    """

    name: str = parameter("path of the parameter that follows")
    to: str = parameter(
        "path of the parameter that it follows; this may also follow another parameter"
    )
    power: float = parameter("exponent; 0 keeps the value", limit=FINITE, default=1.0)


def followed(case: Any, values: Mapping[str, float], links: Sequence[Link]) -> dict[str, float]:
    """Values (SI) of parameters by name, and of parameters that follow them by links, in order.

    A value that a link follows may be computed from variables; it is then not yet checked.

    Raises  Refused if a followed value cannot be computed.
    """
    changed = dict(values)
    for link in links:
        try:
            ratio = number(unchecked(case, changed), link.to) / number(case, link.to)
        except ArithmeticError as error:
            raise Refused(f"{link.to} cannot be computed: {error}") from None
        changed[link.name] = number(case, link.name) * ratio**link.power
    return changed


def _range_of(case: Any, variable: Variable) -> tuple[float, float]:
    """The bounds (SI) of a variable. Raises Refused for a wrong unit or order."""
    low, high = (quantity(case, variable.name, end) for end in (variable.low, variable.high))
    if not low < high:
        raise Refused(
            f"{variable.name}: low must be below high, got {variable.low} and {variable.high}"
        )
    return low, high


def bounds_of(case: Any, variables: Sequence[Variable]) -> list[Bounds]:
    """The variables of any design, with their ranges and values in SI.

    Raises  Refused if a name is not a number of the design, or a bound has a wrong unit or order.
    """
    found = []
    for variable in variables:
        name, start = variable.name, number(case, variable.name)
        low, high = _range_of(case, variable)
        unit = unit_at(case, name)
        shown, size = (unit.shown, 1 / unit.of(1.0)) if unit else ("", 1.0)
        whole = type(find(case, name)) is int
        found.append(
            Bounds(
                name=name,
                low=low,
                high=high,
                start=start,
                log=variable.scale == "log",
                unit=shown,
                size=size,
                whole=whole,
            )
        )
    return found


# Distance from a bound within which a variable is on the bound, as a fraction of its range; by
# hand.
AT_BOUND = 0.01

# Variables that do not change the images of a PSF file.
OF_IMAGES = "instrument.optics.focal_length", "instrument.optics.f_number"


@printed
@dataclass(frozen=True)
class DesignSpace:
    """The designs that differ from `case` in the variables and in values that follow them.

    links  applied in their order, after the variables
    adapt  a Python function that makes the last changes to each design; None: no changes. A design
           that it refuses with a ValueError is not in the space

    Raises  ValueError if a name is not a number of the case, a bound has a wrong unit, the bounds
            are not in order, or the start lies outside them.
    """

    case: Case
    variables: tuple[Variable, ...]
    links: tuple[Link, ...] = ()
    adapt: Callable[[Case], Case] | None = None

    def __post_init__(self) -> None:
        if not self.variables:
            raise Refused("variables must name at least one parameter, got none")
        names = [variable.name for variable in self.variables] + [link.name for link in self.links]
        if len(set(names)) < len(names):
            raise Refused(f"variables must not name a parameter twice, got {', '.join(names)}")
        for variable, (low, high) in zip(self.variables, self._bounds, strict=True):
            self._check(variable, low, high)
        for link in self.links:
            for name in (link.to, link.name):
                if not (value := number(self.case, name)) > 0:
                    shown = text(self.case, name, value)
                    raise Refused(f"{name} must be positive if a link uses it, got {shown}")
        for corner in (np.zeros(len(self)), np.ones(len(self))):
            self._replaced(corner)  # refuses bounds that the parameters refuse

    def _check(self, variable: Variable, low: float, high: float) -> None:
        if variable.scale == "log" and low <= 0:
            raise Refused(f"{variable.name}: low must be positive for a log scale")
        part = variable.name.split(".")
        if part[0] == "variation" and part[-1] != "scale":
            raise Refused(
                f"{variable.name} must be {'.'.join([*part[:2], 'scale'])}, the factor on all "
                "differences of a variation, because the price is for this factor"
            )
        if self.case.instrument.optics.psf_file and variable.name in OF_IMAGES:
            raise Refused(
                f"{variable.name} must not be a variable if psf_file is given, whose images are "
                "those of one lens"
            )
        start = number(self.case, variable.name)
        if not low <= start <= high:
            raise Refused(
                f"{variable.name} must start in its bounds, from {variable.low} to "
                f"{variable.high}, got {text(self.case, variable.name, start)}"
            )

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def start(self) -> Floats:
        """Unit-cube coordinates (n,) of the case itself."""
        return self.coordinates(self.case)

    def coordinates(self, case: Case) -> Floats:
        """Unit-cube coordinates (n,) of a design."""
        return self._coordinates([number(case, variable.name) for variable in self.variables])

    def _coordinates(self, values: Sequence[float]) -> Floats:
        """Unit-cube coordinates (n,) of values (SI) of the variables."""
        result = np.empty(len(self))
        for i, (variable, (low, high)) in enumerate(zip(self.variables, self._bounds, strict=True)):
            value = values[i]
            if variable.scale == "log":
                low, high, value = math.log(low), math.log(high), math.log(value)
            result[i] = (value - low) / (high - low)
        return result

    @property
    def whole(self) -> Flags:
        """Variables (n,) that are whole numbers."""
        return np.array([variable.name in self._whole for variable in self.variables])

    def snapped(self, coordinates: Floats) -> Floats:
        """Coordinates (n,), with whole numbers moved to the coordinates of their rounded values."""
        if not self._whole:
            return coordinates
        rounded = self._coordinates(list(self.values(coordinates).values()))
        return np.where(self.whole, rounded, coordinates)

    def values(self, coordinates: Floats) -> dict[str, float]:
        """The values (SI) of the variables of the design at unit-cube coordinates (n,)."""
        result = {}
        for u, variable, (low, high) in zip(coordinates, self.variables, self._bounds, strict=True):
            u = min(max(float(u), 0.0), 1.0)
            log = variable.scale == "log"
            value = low * (high / low) ** u if log else low + (high - low) * u
            value = min(max(value, low), high)
            result[variable.name] = round(value) if variable.name in self._whole else value
        return result

    def design(self, coordinates: Floats) -> Case:
        """The case at unit-cube coordinates (n,).

        Raises  ValueError if the parameters, or `adapt`, refuse it.
        """
        case = self._replaced(coordinates)
        return self.adapt(case) if self.adapt else case

    def _replaced(self, coordinates: Floats) -> Case:
        return replaced_all(self.case, followed(self.case, self.values(coordinates), self.links))

    def on_bounds(self, case: Case) -> dict[str, str]:
        """The variables that lie within 1 % of their range from a bound, and "low" or "high".

        For such a variable the bound decides, not the model: a wider range could give another
        design.
        """
        return {
            variable.name: "low" if u < 0.5 else "high"
            for variable, u in zip(self.variables, self.coordinates(case).tolist(), strict=True)
            if min(u, 1 - u) <= AT_BOUND
        }

    def labels(self) -> dict[str, str]:
        """The label in tables of each variable, by its name."""
        names = (variable.name for variable in self.variables)
        return {name: parameter_label(self.case, name) for name in names}

    def text(self, case: Case) -> dict[str, str]:
        """The variables of a design as texts, with four digits and a unit."""
        names = (variable.name for variable in self.variables)
        return {name: text(case, name, number(case, name)) for name in names}

    def shown(self, name: str, value: float, digits: int) -> str:
        """A value of a variable as a text, with its unit."""
        return text(self.case, name, value, digits)

    @cached_property
    def _whole(self) -> set[str]:
        """Names of the variables that are whole numbers."""
        names = (variable.name for variable in self.variables)
        return {name for name in names if type(find(self.case, name)) is int}

    @cached_property
    def _bounds(self) -> list[tuple[float, float]]:
        return [_range_of(self.case, variable) for variable in self.variables]


MOST_BRANCHES = 256
EXPOSURE = "instrument.detector.exposure"
OF_DEVICE = ("depleted",)  # keys of the age that belong to the product


class Choice(Parameters):
    """One parameter that takes one of some values."""

    name: str = parameter(
        'path in the case; "instrument.detector" for a product of the catalogue or a file such as '
        '"mine.toml". Its values replace all except exposure, frame rate, binning, row delay and '
        "age; `depleted` of the age is replaced"
    )
    values: tuple[float | str, ...] = parameter(
        "numbers, texts with a unit if the parameter has one, or names"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.values or len(set(self.values)) < len(self.values):
            raise Refused(f"values must be given, each once, got {self.values}")


class Branch(NamedTuple):
    """A case with one value of each choice, and these values."""

    label: str
    case: Case


def branches(case: Case, choices: Sequence[Choice]) -> list[Branch]:
    """Every combination of the choices; without choices, the case alone.

    Raises  ValueError if a value does not fit its parameter, or there are more than 256.
    """
    count = math.prod(len(choice.values) for choice in choices)
    if count > MOST_BRANCHES:
        raise Refused(f"choices must make at most {MOST_BRANCHES} combinations, got {count}")
    made = []
    for values in product(*(choice.values for choice in choices)):
        chosen = {choice.name: value for choice, value in zip(choices, values, strict=True)}
        texts = (f"{name.rpartition('.')[2]} {_short(value)}" for name, value in chosen.items())
        made.append(Branch(", ".join(texts), _chosen(case, chosen)))
    return made


def _short(value: float | str) -> str:
    """A value as a text; for a file, its name without the folder."""
    return Path(value).name if isinstance(value, str) else f"{value:g}"


def _chosen(case: Case, values: Mapping[str, float | str]) -> Case:
    """The case with all values; a product is set first, then the other values change it."""
    rest = dict(values)
    if DETECTOR in rest:
        table = to_table(case)
        detector = table["instrument"]["detector"]
        own = {name: detector[name] for name in KEPT if name in detector}
        defaults = {field.name: field.default for field in fields(case.instrument.detector)}
        own |= {
            name: detector[name]
            for name in OPERATED
            if getattr(case.instrument.detector, name) != defaults[name]
        }
        for name in OF_DEVICE:
            own.get("age", {}).pop(name, None)
        # A product may refuse the exposure of the case, but not the one that is chosen with it.
        if EXPOSURE in rest:
            own["exposure"] = rest.pop(EXPOSURE)
        table["instrument"]["detector"] = {"product": rest.pop(DETECTOR)} | own
        case = from_table(Case, with_product(table))
    return with_values(case, rest)
