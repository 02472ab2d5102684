"""The few ways to refuse a parameter: each names the parameter, the rule and the value."""

from __future__ import annotations

import importlib
import math
from collections.abc import Collection
from typing import Any


class Refused(ValueError):
    """A value that a rule forbids: for a parameter, between parameters, or for the ability of a
    step.

    It is the only error that a search takes as an infeasible design, and that a ledger keeps. Any
    other exception, including another ValueError, is a fault and ends the command.

    key      the parameter, as the message names it; "" if the message is a complete sentence
    rule     the rule for the value; "" likewise
    value    the actual value
    lasting  whether it depends only on the design; refusals by the machine are not kept in a ledger
    """

    def __init__(
        self,
        message: str,
        *,
        key: str = "",
        rule: str = "",
        value: Any = None,
        lasting: bool = True,
    ):
        super().__init__(message)
        self.key, self.rule, self.value, self.lasting = key, rule, value, lasting

    def within(self, place: str, message: str = "") -> Refused:
        """This refusal with the place of the part in its container: "place: message"."""
        key = f"{place}.{self.key}" if self.key else place
        return Refused(
            f"{place}: {message or self}",
            key=key,
            rule=self.rule,
            value=self.value,
            lasting=self.lasting,
        )

    def in_unit(self, unit: str) -> Refused:
        """This refusal of a finite number with a unit; the unit follows the number."""
        number = isinstance(self.value, int | float) and not isinstance(self.value, bool)
        if not (unit and number and math.isfinite(self.value)):
            return self
        return Refused(
            f"{self} {unit}", key=self.key, rule=self.rule, value=self.value, lasting=self.lasting
        )


class WrongType(Refused, TypeError):
    """A value of a wrong type for the parameter."""


# Range of nonzero numbers in a file, in SI units. Chosen by hand: no quantity of a camera lies near
# the ends, and products of some quantities still fit into a float.
SMALLEST, LARGEST_NUMBER = 1e-30, 1e30
LONGEST = 80  # characters of a value in a message


def shown(value: object) -> str:
    """A value in a message: its repr, shortened if it is long."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 2**200:
        return f"a whole number of {math.floor(value.bit_length() * math.log10(2)) + 1} digits"
    if isinstance(value, str | bytes):
        value = value[: LONGEST + 1]
    elif isinstance(value, list | tuple | dict) and len(value) > LONGEST:
        return f"{len(value)} values"
    try:
        text = repr(value)
    except RecursionError:
        return "a deeply nested value"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def of_file(message: str, file: object) -> str:
    """A message with the name of its file before it, once, unless it begins with an option."""
    named = message.startswith((f"{file} ", f"{file}:", "--"))
    return message if named else f"{file}: {message}"


def refusal(key: str, rule: str, value: object, kind: type[Refused] = Refused) -> Refused:
    """The error of a value that breaks a rule: "key rule, got value"."""
    text = str(value) if isinstance(value, float) else shown(value)
    return kind(f"{key} {rule}, got {text}", key=key, rule=rule, value=value)


def moderate(**values: float) -> None:
    """Refuse numbers of a size that no quantity of a camera has; zero is allowed."""
    finite(**values)
    for name, value in values.items():
        if value and not SMALLEST <= abs(value) <= LARGEST_NUMBER:
            rule = f"0 or of a size from {SMALLEST:g} to {LARGEST_NUMBER:g} in SI units"
            raise refusal(name, f"must be {rule}", value)


def finite(**values: float) -> None:
    """Refuse values that are not finite numbers."""
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise refusal(name, "must be a number", value, WrongType)
        try:
            is_finite = math.isfinite(value)
        except OverflowError:  # a whole number beyond all floats
            is_finite = False
        if not is_finite:
            raise refusal(name, "must be finite", value)


def positive(**values: float) -> None:
    """Refuse values that are not above zero."""
    finite(**values)
    for name, value in values.items():
        if value <= 0:
            raise refusal(name, "must be positive", value)


def non_negative(**values: float) -> None:
    """Refuse values below zero."""
    finite(**values)
    for name, value in values.items():
        if value < 0:
            raise refusal(name, "must not be negative", value)


def within(low: float, high: float, /, **values: float) -> None:
    """Refuse values outside [low, high]."""
    finite(**values)
    for name, value in values.items():
        if not low <= value <= high:
            raise refusal(name, f"must lie in [{low:g}, {high:g}]", value)


def whole(low: int, high: int, /, **values: int) -> None:
    """Refuse values that are not integers in [low, high]."""
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int):
            raise refusal(name, "must be a whole number", value, WrongType)
        if not low <= value <= high:
            raise refusal(name, f"must be a whole number in [{low}, {high}]", value)


def optional_package(name: str, needed: str) -> Any:
    """A package that not every installation has, or a module of it.

    Raises  ImportError with the sentence `needed`.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ImportError(needed) from None


def one_of(choices: Collection[str], /, **values: str) -> None:
    """Refuse values that are not among the choices."""
    for name, value in values.items():
        if value not in choices:
            raise refusal(name, f"must be one of {', '.join(choices)}", value)
