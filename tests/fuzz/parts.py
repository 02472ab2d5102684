"""Code that a design may name, none of which does what it should."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

ARRAYS = ("signal", "values", "seen", "value", "x", "direction")


def _like(given: Any) -> np.ndarray:
    """The first array of an input: a shape that may be right."""
    return next(np.asarray(getattr(given, name)) for name in ARRAYS if hasattr(given, name))


def nothing(given: Any) -> None:
    return None


def text(given: Any) -> str:
    return "7"


def nan(given: Any) -> np.ndarray:
    return np.full(_like(given).shape, np.nan)


def three(given: Any) -> np.ndarray:
    return np.full((len(_like(given)), 3), 1e308)


def negative(given: Any) -> np.ndarray:
    return -np.ones(_like(given).shape)


def pairs(given: Any) -> np.ndarray:
    return np.full((5, 2), 2**62)


def mixed(given: Any) -> list:
    return [[1, 2], "x", None]


def turned(given: Any) -> np.ndarray:
    return np.diag([1.0, 1.0, -1.0])


def writes(given: Any) -> np.ndarray:
    _like(given)[...] = 0
    return _like(given)


def divides(given: Any) -> float:
    return 1 / 0


def recurses(given: Any) -> Any:
    return recurses(given)


def ends(given: Any) -> None:
    sys.exit(7)


NAMES = tuple(
    f"{__name__}:{one}"
    for one in (
        "nothing",
        "text",
        "nan",
        "three",
        "negative",
        "pairs",
        "mixed",
        "turned",
        "writes",
        "divides",
        "recurses",
        "ends",
    )
)
