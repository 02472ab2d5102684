"""The command line of every experiment: `--json`, `--quick`, and what is left out."""

from __future__ import annotations

import argparse
import atexit
import importlib.util
import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

DRAWN = ("figure", "figures", "markdown", "out", "picture", "plot")


def read(parser: argparse.ArgumentParser, **smaller: Any) -> argparse.Namespace:
    """The options, with `--json FILE` and `--quick`.

    smaller   values under `--quick` of options that are not given
    Returns   the options; under `--quick`, pictures and tables that are not asked for go to a
              folder that is removed at the end, so that the code that draws them runs as well
    """
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument(
        "--quick", action="store_true",
        help="run every step on the smallest sizes, in seconds; the figures mean nothing",
    )  # fmt: skip
    options = parser.parse_args()
    if options.quick:
        folder = Path(tempfile.mkdtemp())
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        drawn = {name: folder / f"{name}.png" for name in DRAWN if hasattr(options, name)}
        parser.set_defaults(**drawn | smaller)
        options = parser.parse_args()
    return options


def save(options: argparse.Namespace, figures: Any) -> None:
    """Write the figures as JSON where that is asked for."""
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def missing(part: str, *packages: str) -> bool:
    """Whether a package is not installed, without which a part of the experiment is left out."""
    absent = [name for name in packages if importlib.util.find_spec(name) is None]
    if absent:
        print(f"{part} left out: {' and '.join(absent)} not installed", flush=True)
    return bool(absent)


def images(part: str) -> Path | None:
    """The folder of real images, without which a part of the experiment is left out."""
    folder = os.environ.get("STARTRACK_DATA")
    if folder and (Path(folder) / "images" / "truth.json").is_file():
        return Path(folder) / "images"
    print(f"{part} left out: STARTRACK_DATA names no folder with images/truth.json", flush=True)
    return None
