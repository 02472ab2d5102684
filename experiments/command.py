"""Common parts of all experiments: options, figures as JSON, expectations, omitted parts.

`expected.toml` holds the expectations, each with the page that claims the figure and the commit at
which it was measured. An experiment that misses an expectation says so and ends with status 1.
"""

from __future__ import annotations

import argparse
import atexit
import importlib
import importlib.util
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

# Some experiments use reference data of tests, which are in no installation: the checkout is
# searched last.
sys.path.append(str(Path(__file__).parents[1]))

DRAWN = ("figure", "figures", "markdown", "out", "picture", "plot")
EXPECTED = Path(__file__).parent / "expected.toml"


class Expectation(NamedTuple):
    """The range in which a figure of an experiment must lie.

    figure     its place in the JSON, keys and indices joined by "/"; `*` stands for all of a level
    low, high  the range; None: no bound on that side
    claim      the figure as a page states it
    page       the page, and `text`, words of it that hold the claim
    commit     at which the claim was measured
    """

    figure: str
    low: float | None = None
    high: float | None = None
    claim: float | None = None
    page: str = ""
    text: str = ""
    commit: str = ""

    def holds(self, value: Any) -> bool:
        """Whether a figure lies in the range; text and missing values do not."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return isinstance(value, bool) and bool(value) == bool(self.low)
        if value != value:
            return False
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)

    @property
    def range(self) -> str:
        """The range in words."""
        if self.low is None or self.high is None:
            return f"at most {self.high:g}" if self.low is None else f"at least {self.low:g}"
        return f"{self.low:g} to {self.high:g}"


class Judged(NamedTuple):
    """One figure with its expected range; `value` is None if the figure is missing."""

    expectation: Expectation
    place: str
    value: Any

    @property
    def holds(self) -> bool:
        """Whether the expectation is met."""
        return self.value is not None and self.expectation.holds(self.value)

    @property
    def sentence(self) -> str:
        """The figure, the range and the claim."""
        shown = "missing" if self.value is None else f"{self.value:.4g}"
        claim = self.expectation.claim
        claimed = "" if claim is None else f" ({self.expectation.page} says {claim:g})"
        return f"{self.place}: {shown}, expected {self.expectation.range}{claimed}"


def expectations(name: str) -> tuple[Expectation, ...]:
    """The expectations for the figures of an experiment."""
    table = tomllib.loads(EXPECTED.read_text(encoding="utf-8"))
    return tuple(Expectation(**row) for row in table.get(name, ()))


def judge(name: str, figures: Any) -> list[Judged]:
    """The figures of an experiment with their expectations; a missing figure has no value."""
    return [
        Judged(expectation, place, value)
        for expectation in expectations(name)
        for place, value in _found(figures, expectation.figure.split("/"), "")
    ]


def _found(figures: Any, path: list[str], place: str) -> Iterator[tuple[str, Any]]:
    if not path:
        yield place, figures
        return
    head, *rest = path
    if isinstance(figures, list):
        figures = {str(index): value for index, value in enumerate(figures)}
    if not isinstance(figures, dict) or (head != "*" and head not in figures) or not figures:
        yield "/".join(filter(None, (place, *path))), None
        return
    for key in figures if head == "*" else (head,):
        yield from _found(figures[key], rest, f"{place}/{key}" if place else key)


def read(parser: argparse.ArgumentParser, **smaller: Any) -> argparse.Namespace:
    """The options, with `--json FILE` and `--quick`.

    smaller   values under `--quick` of options that are not given
    Returns   the options; under `--quick`, pictures and tables that are not asked for go to a
              folder that is removed at the end, so that the code that draws them runs as well
    """
    parser.add_argument("--json", type=Path, metavar="FILE", help="file for the figures, in JSON")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="run every step in seconds, on sizes too small for meaningful figures",
    )
    options = parser.parse_args()
    if options.quick:
        folder = Path(tempfile.mkdtemp())
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        drawn = {name: folder / f"{name}.png" for name in DRAWN if hasattr(options, name)}
        parser.set_defaults(**drawn | smaller)
        options = parser.parse_args()
    return options


_SAVED: dict[str, Any] = {}  # the figures, and whether they are of a quick or a partial run


def run(main: Callable[[], None]) -> None:
    """Run an experiment; the status is 1 where its figures are not as expected.

    Under `--quick` the figures mean nothing: nothing is expected of them.
    """
    main()
    name = Path(sys.argv[0]).stem
    judged = [] if _SAVED.get("quick", True) else judge(name, _SAVED["figures"])
    if _SAVED.get("partial"):
        judged = [row for row in judged if row.value is not None]
        print("figures of the parts that were left out are not judged")
    missed = [row for row in judged if not row.holds]
    for row in missed:
        print(f"NOT AS EXPECTED: {row.sentence}", file=sys.stderr)
    if judged and not missed:
        print(f"all {len(judged)} figures that have an expectation are as expected")
    if missed:
        sys.exit(1)


def save(options: argparse.Namespace, figures: Any, *, partial: bool = False) -> None:
    """Write the figures as JSON if requested; `run` judges them.

    partial  only some parts of the experiment ran: missing figures are not judged
    """
    _SAVED.update(figures=figures, quick=options.quick, partial=partial)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def shorten(module: str, **constants: Any) -> None:
    """Set constants of a module for a quick run, whose figures nobody reads."""
    for name, value in constants.items():
        setattr(importlib.import_module(module), name, value)


def finite(value: Any) -> Any:
    """The same figures with None for each number that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def commit() -> str:
    """The commit of these sources."""
    words = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    here = Path(__file__).parent
    done = subprocess.run(words, cwd=here, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def source(words: str) -> str:
    """The origin of a page in words: the command and the commit.

    words  the file name of the experiment, with its options
    """
    return f"`python experiments/{words}` at *{commit()}*"


def missing(part: str, *packages: str) -> bool:
    """Whether a package is missing; the part of the experiment that needs it is then left out."""
    absent = [name for name in packages if importlib.util.find_spec(name) is None]
    if absent:
        print(f"{part} left out: {' and '.join(absent)} not installed", flush=True)
    return bool(absent)


def images(part: str) -> Path | None:
    """The folder of real images; without it, a part of the experiment is left out."""
    folder = os.environ.get("STARTRACK_DATA")
    if folder and (Path(folder) / "images" / "truth.json").is_file():
        return Path(folder) / "images"
    print(f"{part} left out: STARTRACK_DATA names no folder with images/truth.json", flush=True)
    return None
