"""Frozen dataclasses to tables of TOML and back, units in strings, each error with its place."""

import dataclasses
import difflib
import typing
import warnings
from collections.abc import Iterator, Mapping
from enum import StrEnum
from typing import Any, TypeVar

from startrack import core
from startrack.core import Refused, Unit, bare, fields_of

T = TypeVar("T")
LONGEST_NAME = 64  # letters of the longest key for which similar keys are searched; by hand
SIMILAR, MOST_PLACES = 0.8, 3  # least similarity of a key in other tables, most places; by hand
NAMES = {float: "a number", int: "a whole number", str: "a string", bool: "true or false"}
LARGEST_INTEGER = 2**63 - 1


def from_table(kind: type[T], table: object, place: str = "") -> T:
    """Build a parameter object from a table.

    kind    a frozen dataclass, whose fields are numbers (a float may be `Annotated` with a Unit),
            strings, tuples, or such dataclasses
    table   the table of the file
    place   path of the table in the file, for messages
    Raises  ValueError that names the place, the rule and the value: for an unknown or a missing
            key, a wrong type or unit, a value that the object itself refuses.

    A class may name keys of earlier versions in `OLD_KEYS`, old name to new one: they are read,
    with a FutureWarning of one line.
    """
    if not isinstance(table, Mapping):
        raise Refused(f"{place or 'the file'} must be a table, got {core.shown(table)}")
    fields = fields_of(kind)  # type: ignore[arg-type]
    table = _with_new_keys(kind, table, place)
    refuse_unknown((kind, table, place))
    values = {key: _read(fields[key], value, _join(place, key)) for key, value in table.items()}
    missing = [name for name, field in fields.items() if name not in values and field.required]
    if missing:
        raise Refused(f"{_join(place, missing[0])} is missing")
    try:
        return kind(**values)
    except (ValueError, TypeError, ArithmeticError) as error:
        odd = isinstance(error, ArithmeticError)
        text = f"values must be of usual sizes together, got: {error}" if odd else str(error)
        raise Refused(_join(place, text)) from None


def refuse_unknown(*tables: tuple[type, object, str]) -> None:
    """Refuse the unknown keys of some tables of a file, each with its kind and place, at once."""
    unknown = [
        message
        for kind, table, place in tables
        if isinstance(table, Mapping)
        for message in _unknown(kind, table, place)
    ]
    if unknown:  # the list of known keys is long, and would hide some messages
        single = len(unknown) == 1
        raise Refused("; ".join(text + choices * single for text, choices in unknown))


def _unknown(kind: Any, table: Mapping[str, Any], place: str) -> Iterator[tuple[str, str]]:
    """Messages about unknown keys of a table and of the tables in it; and the known keys."""
    fields = fields_of(kind)
    for key, value in table.items():
        key = current_key(kind, key)
        inner = fields[key].kind if key in fields else None
        if inner is None:
            names = ", ".join(fields) or "no keys"
            text = f"{_join(place, core.shown(key)[1:-1])} is unknown"
            meant = meant_key(kind, str(key))
            yield (f"{text}{meant}", "") if meant else (text, f"; known here are {names}")
        elif dataclasses.is_dataclass(inner) and isinstance(value, Mapping):
            yield from _unknown(inner, value, _join(place, key))


def meant_key(kind: type, name: str) -> str:
    """The question "; did you mean ...?" for an unknown key of a table: with a similar key of this
    table, or with the places of a similar key in the tables below, where "*" is an entry of a list;
    empty if there are none, or more than a few."""
    if own := difflib.get_close_matches(name[:LONGEST_NAME], fields_of(kind), 1):
        return f"; did you mean {own[0]}?"
    places = dict[str, list[str]]()
    for last, place in _below(kind):
        places.setdefault(last, []).append(place)
    near = difflib.get_close_matches(name[:LONGEST_NAME], places, 1, SIMILAR)
    if not near or len(places[near[0]]) > MOST_PLACES:
        return ""
    return f"; did you mean {' or '.join(places[near[0]])}?"


def _below(kind: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Last part and place of each key in the tables below a class."""
    for name, field in fields_of(kind).items():
        inner, here = field.kind, _join(place, name)
        if place:
            yield name, here
        if typing.get_origin(inner) is tuple:
            inner, here = bare(typing.get_args(inner)[0])[0], f"{here}.*"
        if dataclasses.is_dataclass(inner):
            yield from _below(inner, here)


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
                raise Refused(
                    f"{_join(place, key)} must be left out if {new}, its new name, is given"
                )
            warnings.warn(f"{_join(place, key)} is now called {new}", FutureWarning, stacklevel=4)
        renamed[new] = value
    return renamed


def to_table(value: Any) -> dict[str, Any]:
    """Turn a parameter object into a table that `from_table` reads back to an equal object."""
    return {
        name: written(declared, item)
        for name, declared in fields_of(type(value)).items()  # type: ignore[arg-type]
        if (item := getattr(value, name)) is not None
    }


def written(field: core.Field, value: Any) -> Any:
    """A value in the form of a file: tables, lists, texts with units."""
    return _write(field.kind, field.unit, value)


def _read(field: core.Field, value: object, place: str) -> Any:
    kind, unit = field.kind, field.unit
    if dataclasses.is_dataclass(kind):
        return from_table(typing.cast(type, kind), value, place)
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise Refused(f"{place} must be a list, got {core.shown(value)}")
        own, own_unit = bare(typing.get_args(kind)[0])
        inner = field._replace(kind=own, unit=own_unit or unit)
        return tuple(_read(inner, item, f"{place}[{i}]") for i, item in enumerate(value))
    if unit and kind is float:
        if not isinstance(value, str):
            such = f"such as '1 {unit.shown}', got {core.shown(value)}"
            raise Refused(f"{place} must have a unit, {such}")
        try:
            return _moderate(core.parse(value, unit.si, unit.absolute, unit.clock), place)
        except ValueError as error:
            text = str(error)
            raise Refused(text if text.startswith(place) else f"{place} {text}") from None
    if kind is float and isinstance(value, str) and (share := core.fraction(value)) is not None:
        return _moderate(share, place)
    integer = isinstance(value, int) and not isinstance(value, bool)
    if integer and abs(typing.cast(int, value)) > LARGEST_INTEGER:
        raise Refused(f"{place} must be a number below 2^63, got {core.shown(value)}")
    if kind in (float, core.NUMBER_OR_TEXT) and integer:
        return float(typing.cast(int, value))
    if kind == core.NUMBER_OR_TEXT:
        if not isinstance(value, float | str):
            raise Refused(
                f"{place} must be a number or a string with a unit, got {core.shown(value)}"
            )
        return _moderate(value, place) if isinstance(value, float) else value
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        for member in kind:
            if value == member:
                return member
        raise Refused(f"{place} must be one of {', '.join(kind)}, got {core.shown(value)}")
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise Refused(f"{place} must be {NAMES.get(kind, kind.__name__)}, got {core.shown(value)}")
    if kind is float and not field.open:
        return _moderate(typing.cast(float, value), place)
    return value


def _moderate(value: float, place: str) -> float:
    core.moderate(**{place: value})
    return value


def _write(kind: Any, unit: Unit | None, value: Any) -> Any:
    if dataclasses.is_dataclass(kind):
        return to_table(value)
    if typing.get_origin(kind) is tuple:
        own, own_unit = bare(typing.get_args(kind)[0])
        return [_write(own, own_unit or unit, item) for item in value]
    if isinstance(value, StrEnum):
        return value.value
    if unit and kind is float:
        return core.write(value, unit.si, unit.shown)
    return value


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key
