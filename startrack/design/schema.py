"""The keys of a design file -> a JSON Schema, by which editors complete and check it."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from typing import Any

from startrack.core import LARGEST_NUMBER, Field, Range, Unit, fields_of
from startrack.design.campaign import Campaign
from startrack.design.case import Case
from startrack.design.keys import OF_FILES, PRODUCT, Key, design_keys, item_of, range_of
from startrack.io import LARGEST_INTEGER

DRAFT = "http://json-schema.org/draft-07/schema#"
PERCENTAGE = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*%\s*$"
NUMBER = r"\s*{sign}(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*"
# module:function, or the name that a package gives its entry point
CODE = r"^[A-Za-z_][A-Za-z0-9_.-]*(:[A-Za-z_][A-Za-z0-9_]*)?$"
Schema = dict[str, Any]


@cache
def _meanings() -> dict[str, Key]:
    return {key.name: key for key in design_keys()}


def design_schema() -> Schema:
    """A JSON Schema (draft 7) of design files.

    It has types, ranges, choices and the names of all keys. Whether a unit converts, and rules
    between several keys, are left to `load_design`: a file that it refuses is no design, one that
    it takes may still be none. In a file with `base` or `include` no key is required.
    """
    whole = _table(Case, "")
    campaign, required = _table(Campaign, "campaign"), _required(Case)
    required["properties"]["campaign"] = _required(Campaign)
    detector = required["properties"]["instrument"]["properties"]["detector"]
    either = {"anyOf": [{"required": [name]} for name in ("base", "include")]}
    whole["properties"] |= {"campaign": campaign} | {key.name: _plain(key) for key in OF_FILES}
    within = whole["properties"]["instrument"]["properties"]["detector"]
    within["properties"]["product"] = _plain(PRODUCT)
    with_product = {"required": ["product"]}
    required["properties"]["instrument"]["properties"]["detector"] = {
        "anyOf": [with_product, detector]
    }
    return {
        "$schema": DRAFT,
        "title": "startrack design",
        "description": "A camera, what its tracker believes, and what a study of it is asked.",
        **whole,
        "if": {"not": either},
        "then": required,
    }


def _plain(key: Key) -> Schema:
    text: Schema = {"type": "string"}
    found = {"type": "array", "items": text} if key.kind.startswith("list") else text
    return {"description": key.meaning, **found}


def _table(kind: type, place: str) -> Schema:
    properties = dict[str, Schema]()
    for name, field in fields_of(kind).items():
        where = f"{place}.{name}" if place else name
        properties[name] = {"description": _meanings()[where].meaning} | _value(
            field, range_of(field), where
        )
        if field.default is not None and not dataclasses.is_dataclass(field.kind):
            properties[name] |= _default(_meanings()[where])
    old: Mapping[str, str] = getattr(kind, "OLD_KEYS", {})
    for before, name in old.items():
        properties[before] = properties[name] | {"deprecated": True}
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _default(key: Key) -> Schema:
    return {"markdownDescription": f"{key.meaning}\n\nDefault: `{key.default}`"}


def _value(field: Field, limits: Range, place: str) -> Schema:
    inner, unit = item_of(field)
    if dataclasses.is_dataclass(inner):
        found = _table(typing.cast(type, inner), place)
    else:
        found = _single(inner, unit, limits, field.open)
    return {"type": "array", "items": found} if typing.get_origin(field.kind) is tuple else found


def _single(kind: Any, unit: Unit | None, limits: Range, endless: bool) -> Schema:
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return {"enum": list(kind)}
    if isinstance(kind, types.UnionType):
        return {"type": ["number", "string"]}
    if kind is str:
        if limits.choices and limits.code:
            code = {"type": "string", "pattern": CODE}
            return {"anyOf": [{"enum": list(limits.choices)}, code]}
        return {"enum": list(limits.choices)} if limits.choices else {"type": "string"}
    if kind is bool:
        return {"type": "boolean"}
    if unit:
        return _with_unit(unit, limits)
    most = LARGEST_INTEGER if kind is int else LARGEST_NUMBER
    low, high = max(limits.low, -most), min(limits.high, most)
    if endless:
        low, high = limits.low, limits.high
    found: Schema = {"type": "integer" if kind is int else "number"}
    if low > -float("inf"):
        found["exclusiveMinimum" if limits.above else "minimum"] = low
    found |= {"maximum": high} if high < float("inf") else {}
    if kind is float:  # or a percentage
        found |= {"type": ["number", "string"], "pattern": PERCENTAGE}
    return found


def _with_unit(unit: Unit, limits: Range) -> Schema:
    """A text of a number and a unit; its sign is checked where zero is the limit."""
    signed = limits.low < 0 or unit.absolute  # degC may be below zero
    number = NUMBER.format(sign="[-+]?" if signed else r"\+?")
    found = {"type": "string", "pattern": rf"^{number}[^\s\d].*$"}
    return found | {"examples": [f"1 {unit.shown}"]}


def _required(kind: type) -> Schema:
    """What must be there, of a table and of those within it."""
    found: Schema = {"required": [], "properties": {}}
    for name, field in fields_of(kind).items():
        if field.required:
            found["required"].append(name)
        inner, _ = item_of(field)
        if dataclasses.is_dataclass(inner):
            within = _required(typing.cast(type, inner))
            several = typing.get_origin(field.kind) is tuple
            if any(within.values()):
                found["properties"][name] = {"items": within} if several else within
    return found
