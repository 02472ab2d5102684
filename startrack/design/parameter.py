"""Dotted name, case -> the value at this name, its unit, or a case with other values."""

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple, TypeVar

from startrack.core import Refused, Unit, parse, positive, unit_of
from startrack.io import current_key, meant_key

T = TypeVar("T")


EVERY = "*"


def _entry(entries: tuple[Any, ...], part: str) -> int | None:
    """Index of the entry that a part of a name means, by number or name; for "*", the first."""
    if part.isdecimal():
        return int(part) if int(part) < len(entries) else None
    if part == EVERY:
        return 0 if entries else None
    named = [n for n, entry in enumerate(entries) if getattr(entry, "name", None) == part]
    return named[0] if len(named) == 1 else None


class _Place(NamedTuple):
    """Path that a name means (fields and numbers of entries), and the value at this path."""

    path: tuple[str, ...]
    value: Any


def _places(case: Any, name: str) -> list[_Place]:
    """The parameters that a name means. Arguments and exceptions as for `paths`."""
    parts, at = _parts(case.__class__, name), case
    for part in parts:
        if not _is_field(at.__class__, part):
            break
        at = getattr(at, part)
    else:
        return [_Place(parts, at)]
    made = [_Place((), case)]
    for part in parts:
        made = [
            _Place((*place.path, head), inner)
            for place in made
            for head, inner in _inner(place.value, part, name)
        ]
    return made


@lru_cache(maxsize=1024)
def _parts(kind: type, name: str) -> tuple[str, ...]:
    """The parts of a name, the first without its alias."""
    aliases: Mapping[str, str] = getattr(kind, "ALIASES", {})
    first, *rest = name.split(".")
    return (*aliases.get(first, first).split("."), *rest)


@lru_cache(maxsize=1024)
def _is_field(kind: type, part: str) -> bool:
    """Whether a part of a name is a field of a dataclass, under its present name."""
    return part in getattr(kind, "__dataclass_fields__", ()) and current_key(kind, part) == part


def paths(case: Any, name: str) -> list[str]:
    """The parameters that a name means, with the numbers of entries of lists.

    An entry may be given by its number or by its own `name`: "channels.mir.optics.f_number". "*"
    means every entry. A class may have short names (`ALIASES`) for places in it. A key of an
    earlier version is replaced by the present key, with a FutureWarning of one line.

    Raises  ValueError if there is no such parameter.
    """
    return [".".join(place.path) for place in _places(case, name)]


def _inner(at: Any, part: str, name: str) -> list[tuple[str, Any]]:
    """Value at a part of a name, and the part as a field or a number."""
    if isinstance(at, tuple):
        if part == EVERY and at:
            return [(str(n), entry) for n, entry in enumerate(at)]
        here = _entry(at, part)
        if here is not None:
            return [(str(here), at[here])]
    meant = ""
    if dataclasses.is_dataclass(at):
        kind: Any = type(at)
        key = current_key(kind, part)
        if key != part:
            current = ".".join(key if word == part else word for word in name.split("."))
            warnings.warn(f"{name} is now called {current}", FutureWarning, stacklevel=2)
        if hasattr(at, key):
            return [(key, getattr(at, key))]
        meant = meant_key(kind, part)
    raise Refused(f"{name} must be a parameter of the design, but {part} is none{meant}")


def find(case: Any, name: str) -> Any:
    """Value at a name, such as "instrument.motion.tones.0.rms_x".

    Raises  ValueError if there is no such parameter, or "*" means different values.
    """
    values = [place.value for place in _places(case, name)]
    if any(value != values[0] for value in values[1:]):
        raise Refused(
            f"{name} must have one value in every entry, got {', '.join(map(repr, values))}"
        )
    return values[0]


def number(case: Any, name: str) -> float:
    """The number at a name.

    Raises  ValueError if no such parameter can vary.
    """
    value = find(case, name)
    if isinstance(value, bool) or not isinstance(value, float | int):
        raise Refused(f"{name} must be a number that can vary, got {value!r}")
    return float(value)


def replaced(case: T, name: str, value: Any) -> T:
    """The case with another value at a name; a number is rounded if the old one was whole.

    Raises  ValueError with the name, if the parameter refuses the value.
    """
    return replaced_all(case, {name: value})


def replaced_all(case: T, values: Mapping[str, Any]) -> T:
    """The case with other values at some names, all changed at once.

    Each part of the case is checked with all of its new values, so that values that are valid only
    together can be given together.

    values  values by dotted name; a number is rounded if the old one was whole
    Raises  ValueError with the names of the values that a part of the case refuses; also if one
            name is part of another.
    """
    changed: T = _with(case, _changes(case, values), checked=True)
    return changed


def with_values(case: T, values: Mapping[str, float | str]) -> T:
    """`replaced_all` by numbers, texts with a unit if a parameter has one, or names."""
    in_si = {
        name: value if isinstance(find(case, name), str) else quantity(case, name, value)
        for name, value in values.items()
    }
    return replaced_all(case, in_si)


def with_changes(case: T, changes: Sequence[str]) -> T:
    """The case with other values, each "KEY=VALUE"; values that are not numbers are texts."""
    values = dict[str, float | str]()
    for change in changes:
        key, equals, text = change.partition("=")
        if not equals:
            raise Refused(f"--set must be KEY=VALUE, got {change!r}")
        values[key.strip()] = _number_or_text(text.strip())
    try:
        return with_values(case, values) if values else case
    except Refused as error:
        raise error.within("--set") from None


def _number_or_text(text: str) -> float | str:
    try:
        number = float(text)
    except ValueError:
        return text
    return number if math.isfinite(number) else text


def unchecked(case: T, values: Mapping[str, Any]) -> T:
    """As `replaced_all`, without checks: only for cases from which other values are computed."""
    changed: T = _with(case, _changes(case, values), checked=False)
    return changed


def unit_at(case: Any, name: str) -> Unit | None:
    """The unit of a parameter; None if it has none."""
    parts = paths(case, name)[0].split(".")
    while parts[-1].isdecimal():  # a tuple's numbers have the unit of the tuple
        parts.pop()
    owner = find(case, ".".join(parts[:-1])) if len(parts) > 1 else case
    derived = getattr(type(owner), "DERIVED", {})
    return derived[parts[-1]][0] if parts[-1] in derived else unit_of(type(owner), parts[-1])


def quantity(case: Any, name: str, value: float | str) -> float:
    """A number or a text with a unit as the SI value for a parameter.

    Raises  ValueError if the parameter has a unit and the value none, or the reverse.
    """
    unit = unit_at(case, name)
    if unit and isinstance(value, str):
        try:
            return parse(value, unit.si, unit.absolute, unit.clock)
        except ValueError as error:
            raise Refused(f"{name} {error}") from None
    if unit or isinstance(value, str):
        wanted = f"have a unit, such as '1 {unit.shown}'" if unit else "be a number without unit"
        raise Refused(f"{name} must {wanted}, got {value!r}")
    return float(value)


def label(case: Any, name: str) -> str:
    """Name for tables, without its first part; for a variation, the label of the varied value."""
    first, _, rest = name.partition(".")
    if first != "variation":
        return rest
    number, _, key = rest.partition(".")
    variation = find(case, f"variation.{number}")
    return f"{key} of {variation.name.partition('.')[2]} per {variation.per}"


def text(case: Any, name: str, value: float, digits: int = 4) -> str:
    """A value as a text, with a number of digits and the parameter's unit."""
    unit = unit_at(case, name)
    if not unit:
        return f"{float(f'{value:.{digits}g}'):g}"
    return f"{unit.of(value):.{digits}g} {unit.shown}"


class _Change(NamedTuple):
    """A value, the name by which it was given, and the path of its parameter."""

    name: str
    path: tuple[str, ...]
    value: Any


def _changes(case: Any, values: Mapping[str, Any]) -> list[_Change]:
    changes = []
    for name, value in values.items():
        for place in _places(case, name):
            now = place.value
            if isinstance(now, int) and not isinstance(now, bool) and isinstance(value, float):
                value = round(value)
            changes.append(_Change(name, place.path, value))
    for first in changes:
        for other in changes:
            if first is not other and other.path[: len(first.path)] == first.path:
                raise Refused(f"{first.name} and {other.name} must not be changed together")
    return changes


def _with(owner: Any, changes: list[_Change], checked: bool) -> Any:
    values = dict[str, Any]()
    for head in dict.fromkeys(change.path[0] for change in changes):
        part = owner[int(head)] if isinstance(owner, tuple) else getattr(owner, head)
        own = (change for change in changes if change.path[0] == head)
        inner = [change._replace(path=change.path[1:]) for change in own]
        values[head] = _with(part, inner, checked) if inner[0].path else inner[0].value
    if isinstance(owner, tuple):
        return tuple(values.get(str(at), part) for at, part in enumerate(owner))
    try:
        values = _of_fields(owner, values)
        return dataclasses.replace(owner, **values) if checked else _unchecked(owner, values)
    except Refused as error:
        raise error.within(", ".join(change.name for change in changes)) from None


def _of_fields(owner: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """New values of fields; names in `DERIVED` of the class are replaced by fields that they
    set."""
    derived = getattr(type(owner), "DERIVED", {})
    fields = {name: value for name, value in values.items() if name not in derived}
    for name in values.keys() & derived.keys():
        positive(**{name: values[name]})
        follows = derived[name][1](_unchecked(owner, fields), values[name])
        if taken := fields.keys() & follows.keys():
            raise Refused(f"{name} must not be changed together with {', '.join(taken)}")
        fields |= follows
    return fields


def _unchecked(owner: Any, values: Mapping[str, Any]) -> Any:
    new, own = object.__new__(type(owner)), vars(owner)
    # Its fields alone: its cached properties are not yet computed.
    vars(new).update({name: values.get(name, own[name]) for name in _fields(owner.__class__)})
    return new


@cache
def _fields(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(kind))
