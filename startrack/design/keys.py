"""The keys of a design file: type, unit, range, default and meaning of each."""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from collections.abc import Iterator, Sequence
from enum import StrEnum
from functools import cache
from typing import Any, NamedTuple

from startrack.core import Field, Range, Unit, bare, fields_of, write
from startrack.design.campaign import Campaign
from startrack.design.case import Case, Fidelity
from startrack.io import shipped, written

COLUMNS = (*map(str, Fidelity), "budget")
OF_TRIALS = ("instrument", "tracker", "scene", "catalog")
WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false"}


class Key(NamedTuple):
    """A key of a design file.

    name     its place: "instrument.optics.f_number"; of a list of tables, that within each
    kind     "number", "whole number", "text", "true or false", "list of ...", "table", "tables"
    unit     that a value may have, as a text; "" for none
    range    "above 0", "0 to 1": in that unit; "" where its class states none by itself
    default  as a file would have it; "required" where it must be given, "none" where nothing is
             there unless it is given
    meaning  as its class declares it
    taken_by  "all", or the fidelities (and the error budget) that compute with it, and, in
             brackets, those that run a design with it but leave it out; the others refuse such a
             design. "": trials do not depend on it
    """

    name: str
    kind: str
    unit: str
    range: str
    default: str
    meaning: str
    taken_by: str = ""


# What `load_design` takes from a file before the classes see it.
OF_FILES = (
    Key("base", "text", "", "", "none", "design file below this one, see `load_design`"),
    Key("include", "list of texts", "", "", "none", "files over the base, below this one"),
)
PRODUCT = Key(
    "instrument.detector.product", "text", "", "", "none",
    "detector of the catalogue, whose values hold where the file has none",
)  # fmt: skip
CAMPAIGN = Key("campaign", "table", "", "", "none", "The question that is put to a design.")


@cache
def design_keys() -> tuple[Key, ...]:
    """All keys that a design file may have, in the order of their tables."""
    found = [*OF_FILES, *keys_of(Case), CAMPAIGN]
    found += keys_of(Campaign, "campaign")
    at = next(n for n, key in enumerate(found) if key.name == "instrument.detector") + 1
    found = [*found[:at], PRODUCT, *found[at:]]
    others = json.loads(shipped("designs/fidelities.json").read_text(encoding="utf-8"))
    return tuple(
        key._replace(taken_by=_taken_by(**others.get(key.name, {})))
        if key.name.partition(".")[0] in OF_TRIALS and "table" not in key.kind
        else key
        for key in found
    )


def _taken_by(refused: Sequence[str] = (), left_out: Sequence[str] = ()) -> str:
    """The column of a key; names as of `experiments/key_fidelities.py`, which finds them."""
    taken = [one for one in COLUMNS if one not in refused and one not in left_out]
    if len(taken) == len(COLUMNS):
        return "all"
    return ", ".join(taken) + (f" ({', '.join(left_out)})" if left_out else "")


def keys_of(kind: type, place: str = "") -> Iterator[Key]:
    """The keys of a table that a class of parameters is read from, and of the tables in it."""
    for name, field in fields_of(kind).items():
        inner, unit = item_of(field)
        where = f"{place}.{name}" if place else name
        limits = range_of(field)
        word = f"one of {', '.join(limits.choices)}" if limits.choices else _kind(field, inner)
        word += ", or code" * bool(limits.code)
        meaning = field.meaning or name.replace("_", " ")
        shown = unit.shown if unit else ""
        yield Key(where, word, shown, _range(limits, unit), _default(field), meaning)
        if dataclasses.is_dataclass(inner):
            yield from keys_of(typing.cast(type, inner), where)


def range_of(field: Field) -> Range:
    """What the value of a field may be; of a list, nothing is stated."""
    several = typing.get_origin(field.kind) is tuple
    return Range() if several or field.range is None else field.range


def item_of(field: Field) -> tuple[Any, Unit | None]:
    """The type of a value, or of each of a list, and its unit."""
    if typing.get_origin(field.kind) is not tuple:
        return field.kind, field.unit
    item = bare(typing.get_args(field.kind)[0])
    return item.kind, item.unit or field.unit


def _kind(field: Field, inner: Any) -> str:
    several = typing.get_origin(field.kind) is tuple
    if dataclasses.is_dataclass(inner):
        return "tables" if several else "table"
    if isinstance(inner, type) and issubclass(inner, StrEnum):
        word = f"one of {', '.join(inner)}"
    elif isinstance(inner, types.UnionType):
        word = " or ".join(WORDS[one] for one in typing.get_args(inner))
    else:
        word = WORDS[inner]
    return f"list of {word}s" if several else word


def _range(limits: Range, unit: Unit | None) -> str:
    """The limits in the unit that files have."""

    def text(value: float) -> str:
        if not unit or value == 0:
            return f"{value:g}"
        return f"{float(write(value, unit.si, unit.shown).partition(' ')[0]):.4g}"

    low, high = limits.low, limits.high
    if math.isinf(low) and math.isinf(high):
        return ""
    if math.isinf(high):
        return f"{'above' if limits.above else 'at least'} {text(low)}"
    return f"at most {text(high)}" if math.isinf(low) else f"{text(low)} to {text(high)}"


def _default(field: Field) -> str:
    if field.required:
        return "required"
    if field.default is None:
        return "none"
    if field.unit and isinstance(field.default, float):
        # A file has all digits, which a reader does not need.
        number, _, unit = written(field, field.default).partition(" ")
        return f'"{float(number):.6g} {unit}"'
    if dataclasses.is_dataclass(field.kind):
        return ""  # those of its keys
    return toml(written(field, field.default))


def toml(value: Any) -> str:
    """A value as TOML writes it."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{value}"'
        case list():
            return f"[{', '.join(map(toml, value))}]"
        case dict():
            return f"{{{', '.join(f'{name} = {toml(one)}' for name, one in value.items())}}}"
    return f"{value:g}"
