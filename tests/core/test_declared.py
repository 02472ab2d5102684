"""A parameter that is declared once is checked, and may name code where its declaration says so."""

from dataclasses import dataclass
from typing import Annotated

import pytest

from startrack import Refused
from startrack.core import NON_NEGATIVE, POSITIVE, Parameters, Range, Unit, fields_of


@dataclass(frozen=True)
class Lens(Parameters):
    """Of all kinds of declarations."""

    focal_length: Annotated[float, Unit("m", "mm"), POSITIVE, "of the lens"]
    blur: Annotated[float | None, NON_NEGATIVE] = None
    loss: Annotated[float, Range(0, 1, above=True)] = 0.5
    elements: Annotated[int, Range(1, 20)] = 4
    first: Annotated[int, Range(0)] = 0
    kind: Annotated[str, Range(choices=("thin", "thick"))] = "thin"
    radii: Annotated[tuple[float, ...], POSITIVE] = ()
    methods: Annotated[tuple[str, ...], Range(choices=("own",), code="centroids")] = ()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"focal_length": 0.0}, "focal_length must be positive, got 0.0"),
        ({"blur": -1.0}, "blur must not be negative, got -1.0"),
        ({"loss": 0.0}, "loss must be positive, got 0.0"),
        ({"loss": 1.5}, r"loss must lie in \[0, 1\], got 1.5"),
        ({"loss": "high"}, "loss must be a number, got 'high'"),
        ({"elements": 21}, r"elements must be a whole number in \[1, 20\], got 21"),
        ({"elements": 2.5}, "elements must be a whole number, got 2.5"),
        ({"first": -1}, "first must be at least 0, got -1"),
        ({"kind": "flat"}, "kind must be one of thin, thick, got 'flat'"),
        ({"radii": (1.0, -2.0)}, "radii must be positive, got -2.0"),
        ({"methods": ("own", "other")}, "methods must be one of own, or code as module:function"),
    ],
)
def test_what_lies_outside_its_declaration_is_refused(changed, message):
    with pytest.raises(Refused, match=message):
        Lens(**{"focal_length": 0.05, **changed})


def test_what_lies_within_is_taken_as_it_is():
    lens = Lens(0.05, None, 1.0, 20, 10**12, "thick", (0.1, 0.2), ("own", "mine:centroid"))
    assert lens.methods == ("own", "mine:centroid")


def test_a_declaration_has_unit_range_meaning_and_default():
    field = fields_of(Lens)["focal_length"]
    assert (field.kind, field.unit) == (float, Unit("m", "mm"))
    assert (field.range, field.meaning, field.required) == (POSITIVE, "of the lens", True)
    assert fields_of(Lens)["blur"].default is None
