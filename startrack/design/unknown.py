"""Tables of a design file -> unknown values, each with its law and a drawn value.

An Unknown is an unknown value that is described by a law. It varies neither from unit to unit
(`Variation`) nor from frame to frame.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from startrack.core import Floats, Ints, Refused, Streams, shown

# The keys of each form of a law.
FORMS = (("low", "high"), ("median", "factor"), ("among",), ("among", "weight"))
NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
MOST_CHOICES = 100  # most values of a choice; chosen by hand
INCLUDE = "include"
# Two equivalent keys of a table: a file has APERTURE, a case F_NUMBER.
OPTICS, APERTURE, F_NUMBER = "instrument.optics", "aperture", "f_number"
INSTEAD = {OPTICS: (APERTURE, F_NUMBER)}
Quantile = Callable[[str], float | None]  # name of an unknown -> its quantile; None: its middle


def is_law(value: object) -> bool:
    """Whether a value of a file is the law of an unknown."""
    return isinstance(value, Mapping) and any(value.keys() == set(form) for form in FORMS)


class Unknown(NamedTuple):
    """An unknown value of a design.

    name  its place in the file: "instrument.optics.f_number"; for a choice of files, "include" and
          the common beginning of their names: "include lens"
    law   as in the file: {low, high}, uniform between two values; {median, factor}, lognormal, 68 %
          within a factor of the median; {among, weight}, one of several values, with relative
          weights (by default equal)
    """

    name: str
    law: Mapping[str, Any]

    @property
    def choice(self) -> bool:
        """Whether the law is one of several values."""
        return "among" in self.law

    @property
    def of_one_key(self) -> bool:
        """Whether it is the value of one key, a number or a text, and not a file or a table."""
        values = self.law.get("among", ())
        scalar = all(isinstance(value, str | int | float) for value in values)
        return scalar and not self.name.startswith(f"{INCLUDE} ")

    @property
    def weights(self) -> list[float]:
        """Relative weights of the values of a choice; they sum to 1."""
        values = self.law["among"]
        weights = self.law.get("weight", [1.0] * len(values))
        return [weight / sum(weights) for weight in weights]

    def at(self, quantile: float | None) -> Any:
        """The value at a quantile, in the form of a file.

        quantile  in (0, 1); for a choice, in the order of its values. None: the middle; for a
                  choice, the most probable value, the first of several
        Raises    Refused if the law is malformed.
        """
        self._check()
        if self.choice:
            if quantile is None:
                position = self.weights.index(max(self.weights))
            else:
                position = int(self.positions(np.array([quantile]))[0])
            return self.law["among"][position]
        return self.written(self.numbers(np.array([0.5 if quantile is None else quantile]))[0])

    def written(self, number: float) -> str | float:
        """A number in the unit of its law, in the form of a file."""
        _, unit = _quantity(self.law["median" if "median" in self.law else "low"], self.name)
        return f"{float(number)!r} {unit}" if unit else float(number)

    def positions(self, quantile: Floats) -> Ints:
        """Indices (n,) of the values of a choice that belong to quantiles (n,)."""
        return np.searchsorted(np.cumsum(self.weights)[:-1], quantile, side="right")

    def numbers(self, quantile: Floats) -> Floats:
        """Numbers (n,) at quantiles (n,), in the unit of the file.

        For a choice whose values are not all positive numbers, the indices of the values.
        """
        if self.choice:
            values = self.law["among"] if self.in_order else range(len(self.law["among"]))
            return np.array(values, float)[self.positions(quantile)]
        if "median" in self.law:
            median, _ = _quantity(self.law["median"], f"{self.name}.median")
            return np.asarray(median * self.law["factor"] ** ndtri(quantile))
        (low, _), (high, _) = (
            _quantity(self.law[end], f"{self.name}.{end}") for end in ("low", "high")
        )
        return np.asarray(low + (high - low) * quantile)

    @property
    def in_order(self) -> bool:
        """Whether it is a choice of positive numbers."""
        return all(_is_number(value) and value > 0 for value in self.law.get("among", [""]))

    def _check(self) -> None:
        """Raises Refused if the law is malformed."""
        law, name = self.law, self.name
        if self.choice:
            self._check_choice()
        elif "median" in law:
            number, _ = _quantity(law["median"], f"{name}.median")
            if not number > 0:
                raise Refused(f"{name}.median must be positive, got {law['median']!r}")
            if not _is_number(law["factor"]) or not 1 < law["factor"] <= 1e3:
                raise Refused(f"{name}.factor must lie in (1, 1000], got {law['factor']!r}")
        else:
            low, unit = _quantity(law["low"], f"{name}.low")
            high, other = _quantity(law["high"], f"{name}.high")
            if unit != other:
                raise Refused(f"{name}.high must have the unit of low, {unit!r}, got {other!r}")
            if not low < high:
                raise Refused(
                    f"{name}.low must be below high, got {law['low']!r} and {law['high']!r}"
                )

    def _check_choice(self) -> None:
        name, values, weights = self.name, self.law["among"], self.law.get("weight")
        if not isinstance(values, list) or not 2 <= len(values) <= MOST_CHOICES:
            raise Refused(
                f"{name}.among must be a list of 2 to {MOST_CHOICES} values, got {shown(values)}"
            )
        if weights is not None and not (
            isinstance(weights, list)
            and len(weights) == len(values)
            and all(_is_number(weight) and weight > 0 for weight in weights)
        ):
            raise Refused(
                f"{name}.weight must be a list of {len(values)} positive numbers, one for each "
                f"value, got {weights!r}"
            )

    def __str__(self) -> str:
        law = self.law
        if self.choice:
            return f"one of {', '.join(str(value) for value in law['among'])}"
        if "median" in law:
            return f"{law['median']}, 68 % within a factor of {law['factor']:g}"
        return f"between {law['low']} and {law['high']}"


@lru_cache(maxsize=256)
def stratified(seed: int, name: str, count: int) -> Floats:
    """Numbers (count,) in (0, 1), one in each of `count` equal intervals, in random order.

    The numbers of several names form a Latin hypercube (McKay et al. 1979, Technometrics 21, 239).
    """
    random = Streams(seed, 0)(f"unknown {name}")
    return (random.permutation(count) + random.uniform(1e-9, 1 - 1e-9, count)) / count


class UnknownReader:
    """Replaces laws in the tables of a file by values, and keeps the unknowns in `found`.

    quantile  function: name of an unknown -> its quantile; None: all are at their middle
    """

    def __init__(self, quantile: Quantile | None = None) -> None:
        self._quantile = quantile or (lambda name: None)
        self.found: list[Unknown] = []

    def value(self, name: str, law: Mapping[str, Any]) -> Any:
        """The value of a law, which is added to `found`."""
        unknown = Unknown(name, law)
        value = unknown.at(self._quantile(name))
        if all(unknown.name != other.name for other in self.found):
            self.found.append(unknown)
        return value

    def file(self, entry: object) -> str:
        """The file that an entry of `include` names; the entry may be a choice of files.

        Raises  Refused if it is neither a name nor a law of names.
        """
        if isinstance(entry, str):
            return entry
        names = entry.get("among") if isinstance(entry, Mapping) else None
        if not is_law(entry) or not (
            isinstance(names, list) and all(isinstance(name, str) for name in names)
        ):
            raise Refused(
                "include must be a list of file names, or of choices { among = [...] } of them, "
                f"got {shown(entry)}"
            )
        assert isinstance(entry, Mapping)
        return str(self.value(f"{INCLUDE} {_stem(names)}", entry))

    def table(self, value: Any, place: str = "") -> Any:
        """A table, or a list of tables, with values in place of laws."""
        if is_law(value):
            return self.value(place, value)
        if isinstance(value, dict):
            return {
                key: self.table(inner, f"{place}.{key}" if place else key)
                for key, inner in value.items()
            }
        if isinstance(value, list):
            return [self.table(inner, f"{place}.{n}") for n, inner in enumerate(value)]
        return value


def with_laws(table: dict[str, Any], unknowns: Sequence[Unknown]) -> dict[str, Any]:
    """A table of a design with the laws of unknown values in place of their values.

    Laws of included files and of a detector's product are left out, because they do not belong to
    the values of one file.

    table  changed in place, and returned
    """
    for unknown in unknowns:
        *outer, key = unknown.name.split(".")
        inner: Any = table
        for part in outer:
            inner = inner[int(part)] if isinstance(inner, list) else inner.get(part, {})
        pair = INSTEAD.get(".".join(outer), ())
        if isinstance(inner, list):
            inner[int(key)] = dict(unknown.law)
        elif key in inner:
            inner[key] = dict(unknown.law)
        elif key in pair and (written := next((name for name in pair if name in inner), None)):
            del inner[written]
            inner[key] = dict(unknown.law)
    return table


def _stem(names: Sequence[str]) -> str:
    """First part of the names of files, as words: "lens" for lens-made and lens-shelf."""
    words = [re.split("[-_]", PurePosixPath(name).stem) for name in names]
    shared = itertools.takewhile(lambda parts: len(set(parts)) == 1, zip(*words, strict=False))
    return "-".join(parts[0] for parts in shared) or PurePosixPath(names[0]).stem


def _quantity(value: object, name: str) -> tuple[float, str]:
    """A number and its unit in the form of a file; the unit is empty if the number has none."""
    if _is_number(value):
        return float(value), ""  # type: ignore[arg-type]
    match = NUMBER.fullmatch(value) if isinstance(value, str) and len(value) < 100 else None
    if not match:
        raise Refused(f"{name} must be a number, or a number with a unit, got {shown(value)}")
    return float(match[1]), match[2]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
