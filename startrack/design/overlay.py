"""Design files that refer to a base file and contain only the differences."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from startrack.core import Refused
from startrack.design.files import Design, load_design, save_design, table_of
from startrack.design.products import DETECTOR, PLACE
from startrack.io import name_from, save_toml


def save_over(path: Path, base: Path, table: Mapping[str, Any], comment: str = "") -> None:
    """Write a design file with values that override another file, named relative to its folder."""
    below = name_from(path.resolve().parent, base)
    save_toml(path, {"base": below} | dict(table), comment)


def save_overlay(path: Path, design: Design, base: Path, comment: str = "") -> None:
    """Write the differences of a design from its base file, with all digits, as a design file.

    Comments, included files and laws of unknown values stay in the base file. A chosen detector is
    written by the name of its product. An overlay cannot remove anything from the base file: if it
    does not read back to the design, the whole design is written, as by `save_design`.
    """
    tables = (_over(base, product, design) for product in _products(design))
    for table in sorted((table for table in tables if table is not None), key=_values):
        save_over(path, base, table, comment)
        read = load_design(path)
        if (read.case, read.campaign) == (design.case, design.campaign):
            return
    save_design(path, design, comment)


def _products(design: Design) -> list[str]:
    """Names of the detectors that the campaign may have chosen, with "" (no product) first."""
    choices = design.campaign.choices if design.campaign else ()
    chosen = [choice.values for choice in choices if choice.name == DETECTOR]
    return ["", *(str(product) for values in chosen for product in values)]


def _over(base: Path, product: str, design: Design) -> dict[str, Any] | None:
    """The table that overrides a file.

    product  name of the detector's product; "": its keys are written
    Returns  the table; None if the base file refuses the product
    """
    try:
        below = load_design(base, [f'{PLACE}="{product}"'] if product else [])
    except Refused:
        return None
    table = differences(table_of(below), table_of(design))
    if product:
        table.setdefault("instrument", {}).setdefault("detector", {})["product"] = product
    return table


def _values(table: Mapping[str, Any]) -> int:
    """The number of values in a table and in the tables within it."""
    return sum(_values(value) if isinstance(value, dict) else 1 for value in table.values())


def differences(
    below: Mapping[str, Any], above: Mapping[str, Any], named: Collection[str] = (), place: str = ""
) -> dict[str, Any]:
    """The values of `above` that differ from the values of `below`; a list counts as one value.

    named  places of lists of tables that are compared by the names of their entries, as in
           `LayerRules`
    """
    found = dict[str, Any]()
    for key, value in above.items():
        inner = f"{place}.{key}".removeprefix(".")
        other: Any = below.get(key)
        if inner in named:
            tables = _by_name(other), _by_name(value)
            if tables[0].keys() == tables[1].keys():
                other, value = tables
        if key in below and other == value:
            continue
        both = isinstance(value, dict) and isinstance(other, dict)
        found[key] = differences(other, value, named, inner) if both else value
    return found


def _by_name(entries: Any) -> dict[str, Any]:
    return {entry["name"]: entry for entry in entries or ()}
