"""Table of a design -> the same table with the values of the detector product that it names."""

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
KEPT = "exposure", "age"  # keys of the mission, which are kept if another product is chosen
# Keys of the operation of a detector: also kept, if the design gives them.
OPERATED = "frame_rate", "binning", "row_delay"


def with_product(table: Mapping[str, Any], folder: Path | None = None) -> dict[str, Any]:
    """Replace `product` under `instrument.detector` by that product's values.

    Keys of the design override the catalogue, also within tables. The catalogue's law of ageing is
    used if the design gives an age.

    table    table of a whole design
    folder   folder of a file that is named as a product; None: the working directory
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


def product_file(product: object, folder: Path | None = None) -> Path | None:
    """The file that is named as a product; None for a detector of the catalogue.

    folder  folder of the file; None: the working directory
    """
    is_file = isinstance(product, str) and product.endswith(FILE)
    return (folder or Path()) / str(product) if is_file else None


def of_product(product: object, folder: Path | None = None) -> dict[str, Any]:
    """The table of a detector of the catalogue or of a file (of a detector or a whole design).

    folder  folder of the file; None: the working directory
    Raises  ValueError if there is no such product.
    """
    if (path := product_file(product, folder)) is not None:
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
    """Replace names of detector files in the choices of a campaign by their full paths.

    choices  in the form of a file, changed here; other values are unchanged
    folder   folder of the file that names them
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
