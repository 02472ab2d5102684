"""Frozen dataclasses to tables of TOML and back, units in strings, each error with its place."""

from __future__ import annotations

import dataclasses
import tomllib
import types
import typing
import warnings
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

from startrack.core import Unit, parse, write

T = TypeVar("T")
NUMBER_OR_TEXT = float | str


def from_table(kind: type[T], table: object, place: str = "") -> T:
    """Build a parameter object from a table.

    kind    a frozen dataclass of numbers (a float may be `Annotated` with a Unit), strings,
            tuples, and others of its like
    table   what the file holds there
    place   path of the table in its file, for the errors
    Raises  ValueError that names the place, the rule and the value: for an unknown or a missing
            key, a wrong type or unit, a value that the object itself refuses.

    A class may name keys of earlier versions in `OLD_KEYS`, old name to new one: they are read,
    with a FutureWarning of one line.
    """
    if not isinstance(table, Mapping):
        raise ValueError(f"{place or 'the file'} must be a table, got {table!r}")
    fields = _fields(kind)
    table = _with_new_keys(kind, table, place)
    for key in table:
        if key not in fields:
            raise ValueError(
                f"{_join(place, key)} is unknown; known here are {', '.join(fields) or 'no keys'}"
            )
    values = {
        key: _read(fields[key].kind, fields[key].unit, value, _join(place, key))
        for key, value in table.items()
    }
    missing = [name for name, each in fields.items() if name not in values and each.required]
    if missing:
        raise ValueError(f"{_join(place, missing[0])} is missing")
    try:
        return kind(**values)
    except (ValueError, TypeError) as error:
        raise ValueError(_join(place, str(error))) from None


def current_key(kind: type, key: str) -> str:
    """The name that a key of an earlier version has now; any other key as it is."""
    old: Mapping[str, str] = getattr(kind, "OLD_KEYS", {})
    return old.get(key, key)


def _with_new_keys(kind: type, table: Mapping[str, Any], place: str) -> dict[str, Any]:
    renamed: dict[str, Any] = {}
    for key, value in table.items():
        new = current_key(kind, key)
        if new != key:
            if new in table:
                raise ValueError(f"{_join(place, key)} must not stand beside {new}, its new name")
            warnings.warn(f"{_join(place, key)} is now called {new}", FutureWarning, stacklevel=4)
        renamed[new] = value
    return renamed


def read_table(path: Path, what: str) -> dict[str, Any]:
    """The table of a TOML file.

    what    it must be, for the errors: "a design file"
    Raises  ValueError, one sentence with the file.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{path} must be {what}, but there is none") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise ValueError(f"{path} must be a TOML file: {error}") from None


def to_table(value: Any) -> dict[str, Any]:
    """Turn a parameter object into a table that `from_table` reads back to an equal object."""
    table = {}
    for name, each in _fields(type(value)).items():
        item = getattr(value, name)
        if item is not None:
            table[name] = _write(each.kind, each.unit, item)
    return table


class Field(NamedTuple):
    """A field of a parameter object: its type without None, its unit, whether it must be given."""

    kind: Any
    unit: Unit | None
    required: bool


def unit_of(kind: type, name: str) -> Unit | None:
    """The unit of a field, None where it has none."""
    return _fields(kind)[name].unit


def _fields(kind: type) -> dict[str, Field]:
    hints = typing.get_type_hints(kind, include_extras=True)
    fields = {}
    for entry in dataclasses.fields(kind):
        hint, unit = hints[entry.name], None
        if typing.get_origin(hint) is Annotated:
            hint, unit = typing.get_args(hint)[:2]
        required = entry.default is entry.default_factory is dataclasses.MISSING
        fields[entry.name] = Field(_not_none(hint), unit, required)
    return fields


def _read(kind: Any, unit: Unit | None, value: object, place: str) -> Any:
    if dataclasses.is_dataclass(kind):
        return from_table(typing.cast(type, kind), value, place)
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise ValueError(f"{place} must be a list, got {value!r}")
        inner = typing.get_args(kind)[0]
        return tuple(_read(inner, unit, item, f"{place}[{i}]") for i, item in enumerate(value))
    if unit and kind is float:
        if not isinstance(value, str):
            raise ValueError(f"{place} must have a unit, such as '1 {unit.shown}', got {value!r}")
        try:
            return parse(value, unit.si)
        except ValueError as error:
            raise ValueError(f"{place} {error}") from None
    if kind in (float, NUMBER_OR_TEXT) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if kind == NUMBER_OR_TEXT:
        if not isinstance(value, float | str):
            raise ValueError(f"{place} must be a number or a string with a unit, got {value!r}")
        return value
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        if value not in list(kind):
            raise ValueError(f"{place} must be one of {', '.join(kind)}, got {value!r}")
        return kind(str(value))
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        name = {float: "a number", int: "a whole number", str: "a string", bool: "true or false"}
        raise ValueError(f"{place} must be {name.get(kind, kind.__name__)}, got {value!r}")
    return value


def _write(kind: Any, unit: Unit | None, value: Any) -> Any:
    if dataclasses.is_dataclass(kind):
        return to_table(value)
    if typing.get_origin(kind) is tuple:
        return [_write(typing.get_args(kind)[0], unit, item) for item in value]
    if isinstance(value, StrEnum):
        return value.value
    if unit and kind is float:
        return write(value, unit.si, unit.shown)
    return value


def _not_none(kind: Any) -> Any:
    """The type inside `X | None`."""
    if kind == NUMBER_OR_TEXT:
        return kind
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        return next(one for one in typing.get_args(kind) if one is not types.NoneType)
    return kind


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key
