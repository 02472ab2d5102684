"""Table of a design -> the same with the values of the detector product that it names."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from startrack.core import Refused
from startrack.io import read_table, shipped

PLACE = "instrument.detector.product"
DETECTOR = "instrument.detector"
FILE = ".toml"  # a product that ends so is the name of a file
AGE = "age"
KEPT = "exposure", "age"  # of a detector, where another product takes its place: the mission's
# How a detector is operated: kept likewise, where the design does not leave it to the default.
OPERATED = "frame_rate", "binning", "row_delay"


def with_product(table: Mapping[str, Any], folder: Path | None = None) -> dict[str, Any]:
    """Replace `product` under `instrument.detector` by that product's values.

    Keys of the design override the catalogue, also within tables. What the
    catalogue says of its age counts where the design gives it one.

    table    of a whole design
    folder   in which a file is that is named as a product; None: this process's
    Returns  a table without the key
    Raises   ValueError for a name that the catalogue does not have.
    """
    match table:
        case {"instrument": {"detector": {"product": _} as detector} as instrument}:
            pass
        case _:
            return dict(table)
    own = {key: value for key, value in detector.items() if key != "product"}
    values = of_product(detector["product"], folder)
    if AGE not in own:
        values.pop(AGE, None)
    return {**table, "instrument": {**instrument, "detector": _merge(values, own)}}


def products() -> list[str]:
    """The detectors of the catalogue."""
    return sorted(path.stem for path in shipped("detectors").glob("*.toml"))


def of_product(product: object, folder: Path | None = None) -> dict[str, Any]:
    """The table of a detector of the catalogue, or of a file: alone, or in that of a design.

    folder  in which the file is; None: this process's
    Raises  ValueError if there is none.
    """
    if isinstance(product, str) and product.endswith(FILE):
        path = (folder or Path()) / product
        table = read_table(path, "a detector")
        if "instrument" not in table:
            return table
        match table:
            case {"instrument": {"detector": dict() as detector}}:
                return detector
        raise Refused(f"{path} must have the keys of a detector, or a table [{DETECTOR}]")
    if product not in products():
        raise Refused(
            f"{PLACE} must be one of {', '.join(products())}, or the name of a file such as "
            f"mine.toml, got {product!r}"
        )
    return tomllib.loads(shipped(f"detectors/{product}.toml").read_text(encoding="utf-8"))


def with_product_files(choices: object, folder: Path) -> None:
    """Let the choices of a campaign name files of detectors by their whole paths.

    choices  in the form of a file, changed here; other values are unchanged
    folder   of the file that names them
    """
    for choice in choices if isinstance(choices, list) else ():
        match choice:
            case {"name": str(name), "values": list(values)} if name == DETECTOR:
                choice["values"] = [
                    str((folder / value).resolve())
                    if isinstance(value, str) and value.endswith(FILE)
                    else value
                    for value in values
                ]


def _merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    both = {
        key: _merge(base[key], value)
        if isinstance(base.get(key), Mapping) and isinstance(value, Mapping)
        else value
        for key, value in over.items()
    }
    return {**base, **both}
