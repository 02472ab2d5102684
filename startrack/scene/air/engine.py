"""sasktran2, or a sentence on how to get it; the one file that imports it."""

from __future__ import annotations

import importlib
from typing import Any


def sasktran2(part: str = "") -> Any:
    """The package, or a module of it.

    part    of its name, such as "mie.distribution"
    Errors  ModuleNotFoundError where it is missing.
    """
    try:
        package = importlib.import_module("sasktran2")
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            "new tables of the air need sasktran2: python -m pip install 'startrack[earth]'"
        ) from missing
    return importlib.import_module(f"sasktran2.{part}") if part else package
