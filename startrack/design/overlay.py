"""Design files that lie over another one and hold only what differs from it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from startrack.core import Refused
from startrack.design.files import Design, load_design, save_design
from startrack.design.products import DETECTOR, PLACE
from startrack.design.unknown import with_laws
from startrack.io import name_from, save_text, to_table


def save_over(path: Path, base: Path, table: Mapping[str, Any], comment: str = "") -> None:
    """Write a design file with some values over another file, which is named from its folder."""
    import tomli_w

    below = name_from(path.resolve().parent, base)
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    save_text(path, head + tomli_w.dumps({"base": below} | dict(table)))


def save_overlay(path: Path, design: Design, base: Path, comment: str = "") -> None:
    """Write a design file over the one that it was made from, with all digits of what differs.

    Comments, files that are included and what is not known stay those of the file below. A chosen
    detector has its product's name. Where no such file reads back to the design, for something was
    taken out of it, the whole design is written, as by `save_design`.
    """
    tables = (_over(base, product, design) for product in _products(design))
    for table in sorted((table for table in tables if table is not None), key=_count):
        save_over(path, base, table, comment)
        read = load_design(path)
        if (read.case, read.campaign) == (design.case, design.campaign):
            return
    save_design(path, design, comment)


def _products(design: Design) -> list[str]:
    """None, and the detectors that the campaign may have chosen."""
    choices = design.campaign.choices if design.campaign else ()
    chosen = [choice.values for choice in choices if choice.name == DETECTOR]
    return ["", *(str(product) for values in chosen for product in values)]


def _over(base: Path, product: str, design: Design) -> dict[str, Any] | None:
    """What lies over a file, with the name of a product where there is one; None: nothing can."""
    try:
        below = load_design(base, [f'{PLACE}="{product}"'] if product else [])
    except Refused:
        return None
    table = _differences(_table(below), _table(design))
    if product:
        table.setdefault("instrument", {}).setdefault("detector", {})["product"] = product
    return table


def _count(table: Mapping[str, Any]) -> int:
    """The number of values."""
    return sum(_count(value) if isinstance(value, dict) else 1 for value in table.values())


def _table(design: Design) -> dict[str, Any]:
    table: dict[str, Any] = with_laws(to_table(design.case), design.unknowns)
    campaign = {} if design.campaign is None else {"campaign": to_table(design.campaign)}
    return table | campaign


def _differences(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a table that another one does not have; a list as a whole."""
    found = dict[str, Any]()
    for key, value in above.items():
        if key in below and below[key] == value:
            continue
        both = isinstance(value, dict) and isinstance(below.get(key), dict)
        found[key] = _differences(below[key], value) if both else value
    return found
