"""Table of a design -> the same with the values of the detector product that it names."""

import tomllib
from collections.abc import Mapping
from typing import Any

from startrack.core import Refused
from startrack.io import shipped

PLACE = "instrument.detector.product"
AGE = "age"
KEPT = "exposure", "age"  # of a detector, where another product takes its place: the mission's
# How a detector is operated: kept likewise, where the design does not leave it to the default.
OPERATED = "frame_rate", "binning", "row_delay"


def with_product(table: Mapping[str, Any]) -> dict[str, Any]:
    """Replace `product` under `instrument.detector` by that product's values.

    What the design names beside it overrides the catalogue, key by key in tables too. What the
    catalogue says of its age counts where the design gives it one.

    table    of a whole design
    Returns  a table without the key
    Raises   ValueError for a name that the catalogue does not have.
    """
    match table:
        case {"instrument": {"detector": {"product": _} as detector} as instrument}:
            pass
        case _:
            return dict(table)
    own = {key: value for key, value in detector.items() if key != "product"}
    values = of_product(detector["product"])
    if AGE not in own:
        values.pop(AGE, None)
    return {**table, "instrument": {**instrument, "detector": _merge(values, own)}}


def products() -> list[str]:
    """The detectors of the catalogue."""
    return sorted(path.stem for path in shipped("detectors").glob("*.toml"))


def of_product(product: object) -> dict[str, Any]:
    """The table of a detector of the catalogue; raises ValueError where there is none."""
    if product not in products():
        raise Refused(f"{PLACE} must be one of {', '.join(products())}, got {product!r}")
    return tomllib.loads(shipped(f"detectors/{product}.toml").read_text(encoding="utf-8"))


def _merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    both = {
        key: _merge(base[key], value)
        if isinstance(base.get(key), Mapping) and isinstance(value, Mapping)
        else value
        for key, value in over.items()
    }
    return {**base, **both}
