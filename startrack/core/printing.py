"""A result -> its text, which fits one screen, and its table in a notebook; with units."""

from __future__ import annotations

import dataclasses
import html
import typing
from collections.abc import Collection, Iterable, Iterator
from functools import cache
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core.declared import Parameters, bare, fields_of
from startrack.core.rotations import ra_dec
from startrack.core.units import Unit

Kind = TypeVar("Kind", bound=type)
TextRows = Iterable[tuple[str, ...]]
FEW = 4  # values of a field that are written out; longer fields have number and range
SCALAR = (bool, int, float, str, np.generic)
LONGEST = 80  # characters of a text


def printed(kind: Kind) -> Kind:
    """Let a dataclass or a NamedTuple print its values, each with the unit that its field states.

        @printed
        class Errors(NamedTuple):
            across: Annotated[float, Unit("rad", "arcsec")]

    A class with more to print than its fields has a property `_rows` with rows of texts.
    """

    def rows(self: Any) -> list[tuple[str, ...]]:
        return list(self._rows if hasattr(kind, "_rows") else rows_of(self))

    def __repr__(self: Any) -> str:
        return short_text(kind.__name__, rows(self))

    def _repr_html_(self: Any) -> str:
        return html_table(kind.__name__, rows(self))

    changed: Any = kind
    changed.__repr__ = __repr__
    if not hasattr(kind, "_repr_html_"):
        changed._repr_html_ = _repr_html_
    return kind


def short_text(kind: str, rows: TextRows) -> str:
    """Name of a class and its values on one line, each with its name.

    >>> short_text("Frame", [("size", "512 x 512"), ("exposure", "80 ms")])
    'Frame(size: 512 x 512, exposure: 80 ms)'
    """
    return f"{kind}({', '.join(f'{row[0]}: {row[1]}' for row in rows)})"


def html_table(title: str, rows: TextRows, head: tuple[str, ...] = ()) -> str:
    """A table of HTML; all texts are escaped.

    >>> html_table("<Frame>", [("size", "512 x 512")])
    '<table><caption>&lt;Frame&gt;</caption><tr><td>size</td><td>512 x 512</td></tr></table>'
    """
    lines = [_row("th", head)] if head else []
    lines += [_row("td", row) for row in rows]
    return f"<table><caption>{html.escape(title)}</caption>{''.join(lines)}</table>"


def _row(cell: str, texts: tuple[str, ...]) -> str:
    inner = "".join(f"<{cell}>{html.escape(text)}</{cell}>" for text in texts)
    return f"<tr>{inner}</tr>"


def rows_of(result: Any) -> Iterator[tuple[str, str]]:
    """Name and text of each public field of a dataclass or NamedTuple."""
    kind: Any = type(result)
    for name, unit in _units(kind).items():
        yield name, text_of(getattr(result, name), unit)


@cache
def _units(kind: type) -> dict[str, Unit | None]:
    """The public fields of a dataclass or NamedTuple, with their units."""
    names = getattr(kind, "_fields", None) or [field.name for field in dataclasses.fields(kind)]
    if Parameters in kind.__mro__:
        declared = fields_of(kind)
        return {name: declared[name].unit for name in names if name in declared}
    hints = typing.get_type_hints(kind, include_extras=True)
    return {name: bare(hints[name])[1] for name in names if not name.startswith("_")}


def text_of(value: Any, unit: Unit | None = None) -> str:
    """A value of a result in the unit of files; for arrays, the shape and the range.

    >>> text_of(np.array([0.001, 0.002]), Unit("m", "mm"))
    '1, 2 mm'
    >>> text_of(np.zeros((20, 3)))
    '0 to 0 (20 x 3)'
    """
    if isinstance(value, Rotation):
        return _attitude(value)
    if isinstance(value, bool | np.bool | str):
        text = str(value)
        return text if len(text) <= LONGEST else f"{text[: LONGEST - 4]} ..."
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, float | np.floating):
        return _numbers(np.array([value]), unit)
    if isinstance(value, np.ndarray):
        return _array(value, unit)
    if isinstance(value, dict):
        return _few([f"{key} {text_of(part, unit)}" for key, part in value.items()], value.values())
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return _few([text_of(part, unit) for part in value], value)
    if value is None:
        return "none"
    kind: Any = type(value)
    is_record = dataclasses.is_dataclass(value) or hasattr(value, "_fields")
    parts = [getattr(value, name) for name in _units(kind)] if is_record else []
    if 0 < len(parts) <= FEW and all(isinstance(part, SCALAR) for part in parts):
        return f"{kind.__name__}({', '.join(text_of(part, unit) for part in parts)})"
    return str(kind.__name__)


def _few(texts: list[str], values: Collection[Any]) -> str:
    """The texts of some scalars, or their number."""
    if len(values) <= FEW and all(isinstance(value, SCALAR) for value in values):
        return ", ".join(texts) or "none"
    return f"{len(values)} of {type(next(iter(values))).__name__}"


def _attitude(rotation: Rotation) -> str:
    if not rotation.single:
        return f"{len(rotation)} rotations"
    ((ra, dec),) = ra_dec(rotation.as_matrix()[2:])
    return f"z axis at {ra:.4f}, {dec:+.4f} deg"


def _array(values: np.ndarray, unit: Unit | None) -> str:
    if values.dtype.names:
        return f"{len(values)} rows of {', '.join(values.dtype.names)}"
    shape = f"({' x '.join(map(str, values.shape))})"
    if values.dtype.kind not in "biuf" or not values.size:
        return shape
    if values.dtype.kind == "b":
        return f"{int(values.sum())} true {shape}"
    if values.ndim == 1 and len(values) <= FEW:
        return _numbers(values, unit)
    finite = values[np.isfinite(values)]
    if not finite.size:
        return f"none known {shape}"
    return f"{_numbers(np.array([finite.min(), finite.max()]), unit, ' to ')} {shape}"


def _numbers(values: np.ndarray, unit: Unit | None, between: str = ", ") -> str:
    if values.dtype.kind not in "f" or not unit:
        return between.join(f"{value:.6g}" for value in values.tolist())
    texts = between.join(f"{unit.of(value):.4g}" for value in values.tolist())
    return f"{texts} {unit.shown}"
