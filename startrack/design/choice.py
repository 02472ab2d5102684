"""Choice: a part of a design that is one of several; cases enter, a branch for each leaves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

from startrack.design.case import Case
from startrack.design.parameter import find, quantity, replaced
from startrack.design.products import with_product
from startrack.io import from_table, to_table

MOST_BRANCHES = 256
DETECTOR = "instrument.detector"


@dataclass(frozen=True)
class Choice:
    """One parameter that takes one of some values.

    name    path in the case; "instrument.detector" for a product of the catalogue, whose values
            take the place of all but the exposure
    values  numbers, texts with a unit where the parameter has one, or names
    """

    name: str
    values: tuple[float | str, ...]

    def __post_init__(self) -> None:
        if not self.values or len(set(self.values)) < len(self.values):
            raise ValueError(f"values must be given, each once, got {self.values}")


class Branch(NamedTuple):
    """A case with one value of each choice, and which."""

    label: str
    case: Case


def branches(case: Case, choices: Sequence[Choice]) -> list[Branch]:
    """Every combination of the choices; the case alone where there are none.

    Raises  ValueError where a value does not fit its parameter, or there are more than 256.
    """
    count = math.prod(len(choice.values) for choice in choices)
    if count > MOST_BRANCHES:
        raise ValueError(f"choices must make at most {MOST_BRANCHES} combinations, got {count}")
    return list(_branches(case, choices))


def _branches(case: Case, choices: Sequence[Choice]) -> Iterator[Branch]:
    for values in product(*(choice.values for choice in choices)):
        chosen = case
        for choice, value in zip(choices, values, strict=True):
            chosen = _chosen(chosen, choice.name, value)
        names = (choice.name.rpartition(".")[2] for choice in choices)
        label = ", ".join(f"{name} {_told(v)}" for name, v in zip(names, values, strict=True))
        yield Branch(label, chosen)


def _chosen(case: Case, name: str, value: float | str) -> Case:
    if name == DETECTOR:
        table = to_table(case)
        exposure = table["instrument"]["detector"]["exposure"]
        table["instrument"]["detector"] = {"product": value, "exposure": exposure}
        return from_table(Case, with_product(table))
    text = isinstance(find(case, name), str)
    return replaced(case, name, value if text else quantity(case, name, value))


def _told(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
