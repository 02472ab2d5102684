"""Case, choices -> branches: the cases with each combination of the values of the choices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, NamedTuple

from startrack.core import Refused
from startrack.design.case import Case
from startrack.design.parameter import find, quantity, replaced_all
from startrack.design.products import with_product
from startrack.io import from_table, to_table

MOST_BRANCHES = 256
DETECTOR = "instrument.detector"
EXPOSURE = "instrument.detector.exposure"
KEPT = "exposure", "age"  # of a detector, where another product takes its place: the mission's
OF_DEVICE = ("depleted",)  # of the age


@dataclass(frozen=True)
class Choice:
    """One parameter that takes one of some values."""

    name: Annotated[str,
        'path in the case; "instrument.detector" for a product of the catalogue, whose values '
        "take the place of all but the exposure and the age (whose `depleted` is the product's)"
    ]  # fmt: skip
    values: Annotated[tuple[float | str, ...],
        "numbers, texts with a unit where the parameter has one, or names"]  # fmt: skip

    def __post_init__(self) -> None:
        if not self.values or len(set(self.values)) < len(self.values):
            raise Refused(f"values must be given, each once, got {self.values}")


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
        raise Refused(f"choices must make at most {MOST_BRANCHES} combinations, got {count}")
    return list(_branches(case, choices))


def _branches(case: Case, choices: Sequence[Choice]) -> Iterator[Branch]:
    for values in product(*(choice.values for choice in choices)):
        chosen = _chosen(case, {one.name: v for one, v in zip(choices, values, strict=True)})
        names = (choice.name.rpartition(".")[2] for choice in choices)
        label = ", ".join(f"{name} {_written(v)}" for name, v in zip(names, values, strict=True))
        yield Branch(label, chosen)


def _chosen(case: Case, values: Mapping[str, float | str]) -> Case:
    """All values at once; a product first, whose values the others then change."""
    rest = dict(values)
    if DETECTOR in rest:
        table = to_table(case)
        own = {name: one for name, one in table["instrument"]["detector"].items() if name in KEPT}
        if "age" in own:
            own["age"] = {name: one for name, one in own["age"].items() if name not in OF_DEVICE}
        # A product may refuse the exposure of the case, but not the one that is chosen with it.
        if EXPOSURE in rest:
            own["exposure"] = rest.pop(EXPOSURE)
        table["instrument"]["detector"] = {"product": rest.pop(DETECTOR)} | own
        case = from_table(Case, with_product(table))
    return replaced_all(
        case,
        {
            name: value if isinstance(find(case, name), str) else quantity(case, name, value)
            for name, value in rest.items()
        },
    )


def _written(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
