"""The keys of a design file, as a list, a template with values, and a JSON Schema."""

import dataclasses
import json
import math
import tomllib
import types
import typing
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import cache
from textwrap import wrap
from typing import Any, NamedTuple

from startrack.core import LARGEST_NUMBER, Field, Range, Unit, bare, fields_of
from startrack.design.campaign import Campaign
from startrack.design.case import Case, Fidelity
from startrack.design.measured_tables import TABLES
from startrack.design.products import of_product
from startrack.design.requirements import Requirements
from startrack.design.told import Told
from startrack.design.unknown import FORMS
from startrack.detector import Detector
from startrack.io import LARGEST_INTEGER, from_table, shipped, written

COLUMNS = (*map(str, Fidelity), "budget")
OF_TRIALS = ("instrument", "tracker", "scene", "catalog")
WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false"}


class Key(NamedTuple):
    """A key of a design file.

    name     its place: "instrument.optics.f_number"; in a list of tables, its place in each table
    kind     "number", "whole number", "text", "true or false", "list of ...", "table", "tables"
    unit     unit that a value may have, as a text; "" for none
    range    "above 0", "0 to 1": in this unit; "" if its class declares no range
    default  value in the form of a file; "required" if it must be given, "none" if there is nothing
             by default
    meaning  as its class declares it
    taken_by  "all", or the fidelities (and the error budget) that compute with it; in brackets the
              fidelities that run a design with it but leave it out. All others refuse such a
              design. "": trials do not depend on it
    """

    name: str
    kind: str
    unit: str
    range: str
    default: str
    meaning: str
    taken_by: str = ""


# Keys that `load_design` reads before it constructs the classes.
OF_FILES = (
    Key("base", "text", "", "", "none", "file whose values this file overrides"),
    Key("include", "list of texts", "", "", "none", "files that override the base, but not this"),
)
PRODUCT = Key(
    "instrument.detector.product",
    "text",
    "",
    "",
    "none",
    'detector of the catalogue, or a file next to the design file such as "mine.toml", whose '
    "values hold for keys that the design does not give",
)
APERTURE = Key(
    "instrument.optics.aperture",
    "number",
    "mm",
    "above 0",
    "none",
    "instead of f_number: diameter of the clear aperture, which a campaign keeps if it varies "
    "the focal length",
)
SPECTRUM = Key(
    "instrument.motion.broadband.file",
    "text",
    "",
    "",
    "none",
    "instead of frequency and density: a file next to the design file with a table of both; a "
    'header such as "frequency (Hz), density (urad2 / Hz)" names the units, otherwise they are '
    "Hz and arcsec2 / Hz",
)
# Keys that `load_design` replaces before it constructs the classes, by the keys that they replace.
REPLACED = (
    (PRODUCT, "instrument.detector"),
    (SPECTRUM, "instrument.motion.broadband.density"),
    (APERTURE, "instrument.optics.f_number"),
)
CAMPAIGN = Key("campaign", "table", "", "", "none", "The question that is asked about a design.")
TOLD = Key("told", "tables", "", "", "none", "Figures that were measured or published.")
TABLE = Key(
    "told.file",
    "text",
    "",
    "",
    "none",
    "file next to the design file with a table that gives several figures, with factor as "
    'their common error. With figure = "photon transfer": mean (digital number), variance and '
    "spatial (digital number squared) at levels of uniform light, of which the lowest is dark. "
    'With figure = "star table": magnitude (G), electrons or signal, snr and centroid_noise '
    "(pixel) of stars",
)


@cache
def design_keys() -> tuple[Key, ...]:
    """All keys that a design file may have, in the order of their tables."""
    keys = [*OF_FILES, *keys_of(Case), CAMPAIGN]
    keys += [*keys_of(Campaign, "campaign"), TOLD, *keys_of(Told, "told"), TABLE]
    for replaced, before in REPLACED:
        position = next(n for n, key in enumerate(keys) if key.name == before) + 1
        keys.insert(position, replaced)
    not_all = json.loads(shipped("designs/fidelities.json").read_text(encoding="utf-8"))
    return tuple(
        key._replace(taken_by=_taken_by(**not_all.get(key.name, {})))
        if key.name.partition(".")[0] in OF_TRIALS and "table" not in key.kind
        else key
        for key in keys
    )


def _taken_by(refused: Sequence[str] = (), left_out: Sequence[str] = ()) -> str:
    """The column of a key; names as for `experiments/key_fidelities.py`, which finds them."""
    taken = [column for column in COLUMNS if column not in refused and column not in left_out]
    if len(taken) == len(COLUMNS):
        return "all"
    return ", ".join(taken) + (f" ({', '.join(left_out)})" if left_out else "")


def keys_of(kind: type, place: str = "") -> Iterator[Key]:
    """The keys of the table of a class of parameters, and of the tables in it."""
    for name, field in fields_of(kind).items():
        inner, unit = item_of(field)
        where = f"{place}.{name}" if place else name
        limits = range_of(field)
        word = f"one of {', '.join(limits.choices)}" if limits.choices else _kind(field, inner)
        word += ", or code" * bool(limits.code)
        meaning = field.meaning or name.replace("_", " ")
        shown = ", ".join((unit.shown, *unit.others)) if unit else ""
        yield Key(where, word, shown, _range(limits, unit), _default(field), meaning)
        if dataclasses.is_dataclass(inner):
            yield from keys_of(typing.cast(type, inner), where)


def range_of(field: Field) -> Range:
    """Range of a field's value; for a list, no range is stated."""
    several = typing.get_origin(field.kind) is tuple
    return Range() if several or field.range is None else field.range


def item_of(field: Field) -> tuple[Any, Unit | None]:
    """The type and unit of a value; for a list, of each of its entries."""
    if typing.get_origin(field.kind) is not tuple:
        return field.kind, field.unit
    kind, unit = bare(typing.get_args(field.kind)[0])
    return kind, unit or field.unit


def _kind(field: Field, inner: Any) -> str:
    several = typing.get_origin(field.kind) is tuple
    if dataclasses.is_dataclass(inner):
        return "tables" if several else "table"
    if isinstance(inner, type) and issubclass(inner, StrEnum):
        word = f"one of {', '.join(inner)}"
    elif isinstance(inner, types.UnionType):
        word = " or ".join(WORDS[kind] for kind in typing.get_args(inner))
    else:
        word = WORDS[inner]
    return f"list of {word}s" if several else word


def _range(limits: Range, unit: Unit | None) -> str:
    """The limits in the unit of design files."""

    def text(value: float) -> str:
        return f"{unit.of(value):.4g}" if unit and value else f"{value:g}"

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
        # A file has all digits; a reader does not need them.
        number, _, unit = written(field, field.default).partition(" ")
        return f'"{float(number):.6g} {unit}"'
    if dataclasses.is_dataclass(field.kind):
        return ""  # its keys have the defaults
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
            return f"{{{', '.join(f'{name} = {toml(entry)}' for name, entry in value.items())}}}"
    return f"{value:g}"


EXAMPLE = "designs/nanosatellite.toml"
WIDEST = 100  # letters of a line
# Keys of a detector product that a design chooses.
OWN = ("exposure",)
AGEING = "instrument.detector.dark_current"


def template(product: str = "", optional: bool = False) -> str:
    """The text of a design file that `load_design` reads.

    The values are those of the example in the catalogue, a tracker for a nanosatellite. Limits that
    another detector cannot meet are changed: the power limit is raised by the additional power of
    its read-out, and the update rate is at most the detector's rate.

    product   detector of the catalogue; "": the detector of the example, without a name
    optional  whether optional keys are included, with their defaults, as comments
    Raises    ValueError for a product that the catalogue does not have.
    """
    table = _example()
    if product:
        detector, own = of_product(product), _own_values(table)
        table["instrument"]["detector"] = {"product": product} | own
        table["campaign"]["requirements"] |= _kept_limits(product)
        table["tracker"]["detection"]["saturation"] = float(2 ** detector["bits"] - 1)
        # The example's detector has its own law of ageing; another detector has that of its class.
        del table["tracker"]["detection"]["dark_map_age"]
        rows = [row for row in table.pop("variation") if row["name"] != AGEING]
        if rows:
            table["variation"] = rows
    head = ["# A star tracker; the values are those of an example. All keys: startrack keys"]
    if words := changed_limits(product):
        head.append(f"# {words}")
    return "\n".join([*head, *_tables(table, "", _by_name(), optional)]) + "\n"


def changed_limits(product: str) -> str:
    """The limits in `template` that differ from the example's, and why; "" if none differ.

    product  detector of the catalogue; "": the detector of the example
    """
    limits = _kept_limits(product) if product else {}
    words = " and ".join(f"{name} = {value}" for name, value in limits.items())
    return f"{words}: {product} cannot keep the limit of the example" if words else ""


def _example() -> dict[str, Any]:
    return tomllib.loads(shipped(EXAMPLE).read_text(encoding="utf-8"))


def _own_values(table: dict[str, Any]) -> dict[str, Any]:
    """Values of its detector that a design keeps if a product replaces the detector."""
    return {name: table["instrument"]["detector"][name] for name in OWN}


def _kept_limits(product: str) -> dict[str, str]:
    """Limits, in the form of a file, for a detector that cannot meet the example's limits."""
    table = _example()
    needs = from_table(Requirements, table["campaign"]["requirements"])
    example = _detector(table["instrument"]["detector"])
    own = _detector(of_product(product) | _own_values(table))
    power = needs.max_power + needs.energy_per_bit * max(own.data_rate - example.data_rate, 0.0)
    rate = min(needs.min_update_rate, own.update_rate)
    changes = dict[str, str]()
    if power > needs.max_power:
        changes["max_power"] = f"{_two_digits(power, math.ceil):g} W"
    if rate < needs.min_update_rate:
        changes["min_update_rate"] = f"{_two_digits(rate, math.floor):g} Hz"
    return changes


def _detector(table: dict[str, Any]) -> Detector:
    """A detector without age: the age of a product needs the time of a design."""
    return from_table(Detector, {name: value for name, value in table.items() if name != "age"})


def _two_digits(value: float, whole: Callable[[float], int]) -> float:
    """A positive number that is rounded up or down."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return whole(value / unit) * unit


def _tables(table: Any, place: str, keys: dict[str, Key], optional: bool) -> Iterator[str]:
    """The lines of a table and of those within it."""
    lines = {name: entry for name, entry in table.items() if not _is_table(entry)}
    beside = _left_out(place, set(table), keys) if optional else []
    if place and (lines or beside):
        yield from ("", *_about(keys[place].meaning), f"[{place}]")
    for name, value in lines.items():
        yield from _line(name, toml(value), keys[f"{place}.{name}" if place else name])
    for key in beside:
        yield from _line(f"# {key.name.rpartition('.')[2]}", key.default, key)
    for name, entry in table.items():
        where = f"{place}.{name}" if place else name
        if isinstance(entry, dict):
            yield from _tables(entry, where, keys, optional)
        elif _is_table(entry):
            yield from _rows(entry, where, keys)


def _rows(rows: Iterable[dict[str, Any]], place: str, keys: dict[str, Key]) -> Iterator[str]:
    """Tables of a list; only the first row explains its keys."""
    for number, row in enumerate(rows):
        yield from ("", *(_about(keys[place].meaning) if number == 0 else ()), f"[[{place}]]")
        for name, value in row.items():
            if number == 0:
                yield from _line(name, toml(value), keys[f"{place}.{name}"])
            else:
                yield f"{name} = {toml(value)}"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and isinstance(value[0], dict))


def _left_out(place: str, there: set[str], keys: dict[str, Key]) -> list[Key]:
    return [
        key
        for key in keys.values()
        if key.name.rpartition(".")[0] == place
        and key.kind not in ("table", "tables")
        and key.name.rpartition(".")[2] not in there
        and key.default not in ("required", "none", "")
    ]


def _about(meaning: str) -> list[str]:
    return [f"# {line}" for line in wrap(meaning, WIDEST - 2)]


def _line(name: str, value: str, key: Key) -> Iterator[str]:
    """A value with its meaning in the same line or, if long, above."""
    text, words = f"{name} = {value}", key.meaning + (f" ({key.range})" if key.range else "")
    if max(len(text), 34) + len(words) + 4 <= WIDEST:
        yield f"{text:34s}  # {words}"
    else:
        yield from _about(words)
        yield text


DRAFT = "http://json-schema.org/draft-07/schema#"
PERCENTAGE = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*%\s*$"
NUMBER = r"\s*{sign}(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*"
# module:function, or the name that a package gives its entry point
CODE = r"^[A-Za-z_][A-Za-z0-9_.-]*(:[A-Za-z_][A-Za-z0-9_]*)?$"
Schema = dict[str, Any]


@cache
def _by_name() -> dict[str, Key]:
    return {key.name: key for key in design_keys()}


LAW = {"$ref": "#/definitions/law"}
# Keywords of a schema that check nothing.
ABOUT = ("description", "markdownDescription", "examples")


def design_schema() -> Schema:
    """A JSON Schema (draft 7) of design files.

    It has types, ranges, choices and the names of all keys. Conversion of units, and rules between
    several keys, are left to `load_design`. A file that the schema refuses is not a design; a file
    that it accepts may still be refused. In a file with `base` or `include` no key is required.
    """
    design, required = table_schema(Case), _required(Case)
    required["properties"]["campaign"] = _required(Campaign)
    campaign = {"campaign": table_schema(Campaign, "campaign")}
    figure = table_schema(Told, "told")
    figure["properties"]["file"] = plain_schema(TABLE)
    figure["properties"]["figure"]["enum"] += TABLES
    told: Schema = {"told": {"type": "array", "items": figure}}
    either = {"anyOf": [{"required": [name]} for name in ("base", "include")]}
    design["properties"] |= campaign | {key.name: plain_schema(key) for key in OF_FILES}
    for key, _ in REPLACED:
        place, _, name = key.name.rpartition(".")
        _table_at(design, place)["properties"][name] = plain_schema(key)
    _allow_laws(design)
    design["properties"] |= told
    design["properties"]["include"]["items"] = {"anyOf": [{"type": "string"}, LAW]}
    parts = required["properties"]["instrument"]["properties"]
    parts["detector"] = {"anyOf": [{"required": ["product"]}, parts["detector"]]}
    parts["optics"]["required"].remove("f_number")
    parts["optics"]["oneOf"] = [{"required": [name]} for name in ("f_number", "aperture")]
    spectra = parts["motion"]["properties"]["broadband"]
    spectra["items"] = {"anyOf": [{"required": ["axis", "file"]}, spectra["items"]]}
    return {
        "$schema": DRAFT,
        "title": "startrack design",
        "description": "A camera, the assumptions of its tracker, and a campaign of study on it.",
        "definitions": {"law": {"anyOf": [_law_schema(form) for form in FORMS]}},
        **design,
        "if": {"not": either},
        "then": required,
    }


def _table_at(schema: Schema, place: str) -> Schema:
    """Schema of the table at a place; for a list of tables, the schema of each."""
    for name in place.split("."):
        schema = schema["properties"][name]
        schema = schema.get("items", schema)
    return schema


def _law_schema(form: Collection[str]) -> Schema:
    """Schema of the law of an unknown value; the values are checked when they are drawn."""
    some = {"type": "array", "minItems": 2}
    kinds = {"factor": {"type": "number"}, "among": some, "weight": some}
    properties: Schema = {key: kinds.get(key, {"type": ["number", "string"]}) for key in form}
    keys = {"properties": properties, "required": sorted(form)}
    return {"type": "object", "additionalProperties": False, **keys}


def _allow_laws(schema: Schema) -> None:
    """Allow a law for each value of a table and of the tables in it, except the campaign."""
    for name, value in schema.get("properties", {}).items():
        if name == "campaign":
            continue
        within = value.get("items", value)
        if "properties" in within:
            _allow_laws(within)
        elif "deprecated" not in value and name not in ("base", "include"):
            rule = {key: value.pop(key) for key in list(value) if key not in ABOUT}
            value["anyOf"] = [rule, LAW]


def plain_schema(key: Key) -> Schema:
    """Schema of a text, or of a list of texts."""
    text: Schema = {"type": "string"}
    schema = {"type": "array", "items": text} if key.kind.startswith("list") else text
    return {"description": key.meaning, **schema}


def table_schema(kind: type, place: str = "", keys: Mapping[str, Key] | None = None) -> Schema:
    """A JSON Schema of the table of a class of parameters.

    place  place of the table in its file
    keys   keys by their names, for their meanings; None: the keys of a design file
    """
    keys = _by_name() if keys is None else keys
    properties = dict[str, Schema]()
    for name, field in fields_of(kind).items():
        where = f"{place}.{name}" if place else name
        key = keys[where]
        properties[name] = {"description": key.meaning} | _value(
            field, range_of(field), where, keys
        )
        if field.default is not None and not dataclasses.is_dataclass(field.kind):
            properties[name]["markdownDescription"] = f"{key.meaning}\n\nDefault: `{key.default}`"
    old: Mapping[str, str] = getattr(kind, "OLD_KEYS", {})
    for before, name in old.items():
        properties[before] = properties[name] | {"deprecated": True}
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _value(field: Field, limits: Range, place: str, keys: Mapping[str, Key]) -> Schema:
    inner, unit = item_of(field)
    if dataclasses.is_dataclass(inner):
        schema = table_schema(typing.cast(type, inner), place, keys)
    else:
        schema = _single(inner, unit, limits, field.open)
    return {"type": "array", "items": schema} if typing.get_origin(field.kind) is tuple else schema


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
    schema: Schema = {"type": "integer" if kind is int else "number"}
    if low > -float("inf"):
        schema["exclusiveMinimum" if limits.above else "minimum"] = low
    schema |= {"maximum": high} if high < float("inf") else {}
    if kind is float:  # or a percentage
        schema |= {"type": ["number", "string"], "pattern": PERCENTAGE}
    return schema


def _with_unit(unit: Unit, limits: Range) -> Schema:
    """A text of a number and a unit; its sign is checked where zero is the limit."""
    signed = limits.low < 0 or unit.absolute  # degC may be below zero
    number = NUMBER.format(sign="[-+]?" if signed else r"\+?")
    schema = {"type": "string", "pattern": rf"^{number}[^\s\d].*$"}
    return schema | {"examples": [f"1 {name}" for name in (unit.shown, *unit.others)]}


def _required(kind: type) -> Schema:
    """Required keys of a table and of the tables in it."""
    schema: Schema = {"required": [], "properties": {}}
    for name, field in fields_of(kind).items():
        if field.required:
            schema["required"].append(name)
        inner, _ = item_of(field)
        if dataclasses.is_dataclass(inner):
            within = _required(typing.cast(type, inner))
            several = typing.get_origin(field.kind) is tuple
            if any(within.values()):
                schema["properties"][name] = {"items": within} if several else within
    return schema
