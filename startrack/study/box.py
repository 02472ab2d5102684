"""Variable, Box: named parameters of a case as points of a unit cube."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.case import Case
from startrack.checks import one_of
from startrack.tables import unit_of
from startrack.units import Unit, parse, write


@dataclass(frozen=True)
class Variable:
    """One parameter that may change.

    name       path in the case, such as "instrument.optics.focal_length"
    low, high  bounds, with a unit where the parameter has one
    scale      "linear" or "log": how the range is walked through
    """

    name: str
    low: float | str
    high: float | str
    scale: str = "linear"

    def __post_init__(self) -> None:
        one_of(("linear", "log"), scale=self.scale)


@dataclass(frozen=True)
class Box:
    """The designs that differ from `case` in the variables alone.

    Errors  ValueError where a name is no number of the case, a bound has a wrong unit, the bounds
            are not in order, or the start lies outside them.
    """

    case: Case
    variables: tuple[Variable, ...]

    def __post_init__(self) -> None:
        if not self.variables:
            raise ValueError("variables must name at least one parameter, got none")
        names = [variable.name for variable in self.variables]
        if len(set(names)) < len(names):
            raise ValueError(f"variables must not name a parameter twice, got {', '.join(names)}")
        for variable, (low, high) in zip(self.variables, self._bounds, strict=True):
            if not low < high:
                raise ValueError(
                    f"{variable.name}: low must be below high, got {variable.low} and "
                    f"{variable.high}"
                )
            if variable.scale == "log" and low <= 0:
                raise ValueError(f"{variable.name}: low must be positive for a log scale")
            start = _get(self.case, variable.name)
            if not low <= start <= high:
                raise ValueError(
                    f"{variable.name} must start in its bounds, from {variable.low} to "
                    f"{variable.high}, got {self._text(variable, start)}"
                )
        self.design(np.zeros(len(self))), self.design(np.ones(len(self)))

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def start(self) -> NDArray[np.float64]:
        """The place (n,) of the case itself in the unit cube."""
        return self.place(self.case)

    def place(self, case: Case) -> NDArray[np.float64]:
        """The place (n,) of a design in the unit cube."""
        result = np.empty(len(self))
        for i, (variable, (low, high)) in enumerate(zip(self.variables, self._bounds, strict=True)):
            value = _get(case, variable.name)
            if variable.scale == "log":
                low, high, value = math.log(low), math.log(high), math.log(value)
            result[i] = (value - low) / (high - low)
        return result

    def values(self, place: NDArray[np.float64]) -> dict[str, float]:
        """The values (SI) of the variables at a place in the unit cube."""
        result = {}
        for u, variable, (low, high) in zip(place, self.variables, self._bounds, strict=True):
            u = min(max(float(u), 0.0), 1.0)
            log = variable.scale == "log"
            value = low * (high / low) ** u if log else low + (high - low) * u
            result[variable.name] = min(max(value, low), high)
        return result

    def design(self, place: NDArray[np.float64]) -> Case:
        """The case at a place in the unit cube."""
        case = self.case
        for name, value in self.values(place).items():
            try:
                case = _with(case, name.split("."), value)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
        return case

    def text(self, case: Case) -> dict[str, str]:
        """The variables of a design as a person writes them, four digits and a unit."""
        return {
            variable.name: self._text(variable, _get(case, variable.name))
            for variable in self.variables
        }

    @cached_property
    def _bounds(self) -> list[tuple[float, float]]:
        return [(self._si(v, v.low), self._si(v, v.high)) for v in self.variables]

    def _si(self, variable: Variable, bound: float | str) -> float:
        unit = _unit(self.case, variable.name)
        if unit and isinstance(bound, str):
            try:
                return parse(bound, unit.si)
            except ValueError as error:
                raise ValueError(f"{variable.name}: bound {error}") from None
        if unit or isinstance(bound, str):
            wanted = (
                f"have a unit, such as '1 {unit.shown}'" if unit else "be a number without unit"
            )
            raise ValueError(f"{variable.name}: bound must {wanted}, got {bound!r}")
        return float(bound)

    def _text(self, variable: Variable, value: float) -> str:
        unit = _unit(self.case, variable.name)
        rounded = float(f"{value:.4g}")
        if not unit:
            return f"{rounded:g}"
        number, _, name = write(value, unit.si, unit.shown).partition(" ")
        return f"{float(number):.4g} {name}"


def _get(case: Any, name: str) -> float:
    for part in name.split("."):
        if not dataclasses.is_dataclass(case) or not hasattr(case, part):
            raise ValueError(f"{name} must be a parameter of the design, but {part} is none")
        case = getattr(case, part)
    if isinstance(case, bool) or not isinstance(case, float):
        raise ValueError(f"{name} must be a number that can vary, got {case!r}")
    return case


def _with(owner: Any, parts: list[str], value: float) -> Any:
    if len(parts) > 1:
        value = _with(getattr(owner, parts[0]), parts[1:], value)
    return dataclasses.replace(owner, **{parts[0]: value})


def _unit(case: Any, name: str) -> Unit | None:
    """The unit of a parameter, None where it has none."""
    _get(case, name)
    *owners, last = name.split(".")
    for part in owners:
        case = getattr(case, part)
    return unit_of(type(case), last)
