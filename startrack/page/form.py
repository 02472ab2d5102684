"""Tables of a design, its keys -> rows of a form, and sliders of the campaign's variables."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from startrack.design import Key, found_at
from startrack.problem import Bounds

MOST_LETTERS = 400  # letters of a shown value; longer lists are edited in the file
ONE_OF = "one of "


def rows(table: Mapping[str, Any], keys: Sequence[Key]) -> list[dict[str, Any]]:
    """A row for each key that a form can change, in the order of the keys.

    table  table of the design, as in a file
    """
    values: dict[str, dict[str, Any]] = {}
    for path, value in _leaves(table, ""):
        parts = [part for part in path.split(".") if not part.isdecimal()]
        values.setdefault(".".join(parts), {})[path] = value
    lists = tuple(f"{key.name}." for key in keys if key.kind == "tables")
    found = []
    for key in keys:
        if "table" in key.kind or key.name in ("base", "include"):
            continue
        here = values.get(key.name, {})
        if not here and not key.name.startswith(lists):
            here = {key.name: None}
        found += [_row(path, value, key) for path, value in here.items()]
    return found


def _row(path: str, value: Any, key: Key) -> dict[str, Any]:
    text = "" if value is None else value if isinstance(value, str) else json.dumps(value)
    choices = key.kind.removeprefix(ONE_OF).removesuffix(", or code").split(", ")
    if key.kind == "true or false":
        choices = ["true", "false"]
    return key._asdict() | {
        "key": path,
        "value": text,
        "editable": len(text) <= MOST_LETTERS,
        "choices": choices if key.kind.startswith((ONE_OF, "true or")) else [],
    }


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Paths and values of a table, with the numbers of entries of lists of tables."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(inner, f"{path}.{name}" if path else name)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for number, inner in enumerate(value):
            yield from _leaves(inner, f"{path}.{number}")
    else:
        yield path, value


def sliders(design: Any, variables: Sequence[Bounds]) -> list[dict[str, Any]]:
    """Variables of a design, in the units of its file."""
    return [
        {
            "key": variable.name,
            "low": variable.low / variable.size,
            "high": variable.high / variable.size,
            "value": variable.start / variable.size,
            "log": variable.log,
            "unit": variable.unit,
            "si": variable.size,
            "whole": type(found_at(design, variable.name)) is int,
        }
        for variable in variables
    ]
