"""The few ways to refuse a parameter: each names the parameter, the rule and the value."""

from __future__ import annotations

import math
from collections.abc import Collection


def finite(**values: float) -> None:
    """Refuse what is not a finite number."""
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise TypeError(f"{name} must be a number, got {value!r}")
        if not math.isfinite(value):
            raise ValueError(f"{name} must be finite, got {value}")


def positive(**values: float) -> None:
    """Refuse what is not above zero."""
    finite(**values)
    for name, value in values.items():
        if value <= 0:
            raise ValueError(f"{name} must be positive, got {value}")


def non_negative(**values: float) -> None:
    """Refuse what is below zero."""
    finite(**values)
    for name, value in values.items():
        if value < 0:
            raise ValueError(f"{name} must not be negative, got {value}")


def within(low: float, high: float, /, **values: float) -> None:
    """Refuse what lies outside [low, high]."""
    finite(**values)
    for name, value in values.items():
        if not low <= value <= high:
            raise ValueError(f"{name} must lie in [{low:g}, {high:g}], got {value}")


def whole(low: int, high: int, /, **values: int) -> None:
    """Refuse what is not an integer in [low, high]."""
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int):
            raise TypeError(f"{name} must be a whole number, got {value!r}")
        if not low <= value <= high:
            raise ValueError(f"{name} must be a whole number in [{low}, {high}], got {value}")


def one_of(choices: Collection[str], /, **values: str) -> None:
    """Refuse what is not one of the choices."""
    for name, value in values.items():
        if value not in choices:
            raise ValueError(f"{name} must be one of {', '.join(choices)}, got {value!r}")
