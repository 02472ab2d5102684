"""The keys of a design file: type, unit, range, default and meaning of each."""

from __future__ import annotations

import dataclasses
import inspect
import json
import math
import re
import types
import typing
from collections.abc import Iterator, Sequence
from enum import StrEnum
from functools import cache
from typing import Annotated, Any, NamedTuple

from startrack.core import Unit, write
from startrack.design.campaign import Campaign
from startrack.design.case import Case, Fidelity
from startrack.design.ranges import Range, ranges_of
from startrack.io import Field, fields_of, shipped, written

ENTRY = re.compile(r"((?:\w+)(?:, \w+)*)\s+(\S.*)")
# In the docstrings, which have SI units; a file has its own.
ONE = "(1|metre|radian|second|kelvin|hertz|kilogram|watt)"
SI = re.compile(rf"\A{ONE}(\^2)?( / {ONE})*(, |\Z| (?=by|from|above|of|about|after))")
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
    meaning  from the docstring of its class
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


@cache
def design_keys() -> tuple[Key, ...]:
    """All keys that a design file may have, in the order of their tables."""
    found = [*OF_FILES, *keys_of(Case), Key("campaign", "table", "", "", "none", _first(Campaign))]
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
    meanings, ranges = meanings_of(kind), ranges_of(kind)
    for name, field in fields_of(kind).items():
        inner, unit = item_of(field)
        table = dataclasses.is_dataclass(inner)
        meaning = SI.sub("", meanings.get(name, ""), 1) if name in meanings else ""
        meaning = meaning or (_first(inner) if table else name.replace("_", " "))
        where = f"{place}.{name}" if place else name
        shown = unit.shown if unit else ""
        limits = ranges.get(name, Range())
        word = f"one of {', '.join(limits.choices)}" if limits.choices else _kind(field, inner)
        word += ", or code" * limits.code
        yield Key(where, word, shown, _range(limits, unit), _default(field), meaning)
        if table:
            yield from keys_of(inner, where)


def item_of(field: Field) -> tuple[Any, Unit | None]:
    """The type of a value, or of each of a list, and its unit."""
    kind, unit = field.kind, field.unit
    if typing.get_origin(kind) is not tuple:
        return kind, unit
    kind = typing.get_args(kind)[0]
    if typing.get_origin(kind) is Annotated:
        kind, unit = typing.get_args(kind)[:2]
    return kind, unit


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


def _first(kind: type) -> str:
    """The first sentence of a docstring."""
    return (inspect.getdoc(kind) or "").split("\n\n")[0].replace("\n", " ")


def meanings_of(kind: type) -> dict[str, str]:
    """What the docstring of a class says of its fields, by their names.

    A line `name  text` or `rms_x, _y, _z  text` begins an entry, indented ones go on with it.
    """
    fields, found, current = set(fields_of(kind)), dict[str, str](), list[str]()
    for line in (inspect.getdoc(kind) or "").splitlines():
        entry = ENTRY.fullmatch(line)
        names = _names(entry[1], fields) if entry else []
        if entry and names:
            current = names
            found |= dict.fromkeys(names, entry[2])
        elif line.startswith("    ") and current:
            found |= {name: f"{found[name]} {line.strip()}" for name in current}
        else:
            current = []
    return found


def _names(text: str, fields: set[str]) -> list[str]:
    """The fields of "rms_x, _y": each part alone, or with the beginning of the first."""
    first, *others = text.split(", ")
    stem = first.rpartition("_")[0]
    names = [first, *(f"{stem}{one}" if one.startswith("_") else one for one in others)]
    return names if set(names) <= fields else []
