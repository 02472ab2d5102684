"""How the commands speak: results on standard output, messages and progress on standard error."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, open_sky
from startrack.cli.exits import WrongUse
from startrack.core import Stars, arcsec
from startrack.design import Campaign, Design, load_design
from startrack.io import shipped
from startrack.metrics import Interval, Summary
from startrack.sequence import Sequence, load_sequence

NAMED = ("bright", "deep")  # catalogues


def example() -> Path:
    """The design that is shipped: a tracker for a nanosatellite."""
    return shipped("designs/nanosatellite.toml")


def read_design(path: Path) -> Design:
    """The design of a file, its errors as wrong use."""
    try:
        return load_design(path)
    except ValueError as error:
        raise WrongUse(str(error)) from None


def read_campaign(path: Path) -> tuple[Design, Campaign]:
    """A design that comes with a campaign."""
    design = read_design(path)
    if design.campaign is None or not design.campaign.variables:
        raise WrongUse(f"{path} must have a table [campaign] that names variables")
    return design, design.campaign


def read_sequence(path: Path) -> Sequence:
    """The sequence of a file, its errors as wrong use."""
    try:
        return load_sequence(path)
    except ValueError as error:
        raise WrongUse(str(error)) from None


def read_stars(catalog: str, epoch: float) -> Stars:
    """The stars of `--catalog` at a year, its errors as wrong use."""
    if catalog not in NAMED and not Path(catalog).is_file():
        raise WrongUse(f"--catalog must be {' or '.join(NAMED)}, or a file, got {catalog!r}")
    try:
        return open_sky(Selection.whole(catalog, epoch)).stars
    except (ValueError, OSError, ImportError) as error:
        raise WrongUse(str(error)) from None


def say(message: str) -> None:
    """Tell the person at the terminal."""
    print(message, file=sys.stderr)


def tell(options: argparse.Namespace, result: dict[str, Any], text: str) -> None:
    """Print a result: one JSON object on a line where that was asked for, the text otherwise."""
    if options.json:
        print(json.dumps(finite(result), allow_nan=False), flush=True)
    else:
        print(text, flush=True)


def finite(value: Any) -> Any:
    """The same value with None for each number that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


@contextmanager
def progress(title: str, total: int) -> Iterator[Callable[..., None]]:
    """A bar on standard error, where a person looks at it.

    Its function takes by how many it advances, and what to say beside it from now on.
    """
    if not sys.stderr.isatty():
        yield lambda count, note="": None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(title, total=total, note="")

        def advance(count: int, note: str = "") -> None:
            bars.advance(task, count)
            if note:
                bars.update(task, note=note)

        yield advance


def quaternion(rotation: Rotation) -> list[float]:
    """Scalar last, the scalar not negative."""
    return [float(x) for x in rotation.as_quat(canonical=True)]


def in_arcsec(interval: Interval) -> dict[str, float]:
    """An interval of radians in arcseconds."""
    return {name: getattr(interval, name) / arcsec for name in ("value", "low", "high")}


def summary_values(summary: Summary) -> dict[str, Any]:
    """A summary for JSON; the intervals hold the true value with 95 % confidence."""
    across, about = in_arcsec(summary.across), in_arcsec(summary.about)
    return {
        "across_rms_arcsec": across["value"],
        "across_rms_arcsec_95": [across["low"], across["high"]],
        "about_rms_arcsec": about["value"],
        "about_rms_arcsec_95": [about["low"], about["high"]],
        "availability": summary.availability.value,
        "availability_95": [summary.availability.low, summary.availability.high],
        "false_attitudes": summary.false.value,
        "false_attitudes_95": [summary.false.low, summary.false.high],
        "nees": summary.nees,
        "stars": summary.stars,
        "trials": summary.trials,
    }


def summary_text(summary: Summary) -> str:
    """A summary for a person."""
    across, about = in_arcsec(summary.across), in_arcsec(summary.about)
    fraction = summary.availability
    return "\n".join(
        [
            f"across the boresight  {across['value']:9.3f} arcsec rms per axis "
            f"[{across['low']:.3f}, {across['high']:.3f}]",
            f"about the boresight   {about['value']:9.3f} arcsec rms "
            f"[{about['low']:.3f}, {about['high']:.3f}]",
            f"availability          {100 * fraction.value:9.2f} % "
            f"[{100 * fraction.low:.2f}, {100 * fraction.high:.2f}]",
            f"false attitudes       {100 * summary.false.value:9.2f} % "
            f"[{100 * summary.false.low:.2f}, {100 * summary.false.high:.2f}]",
            f"matched stars         {summary.stars:9.1f}",
            f"error^2 / variance    {summary.nees:9.2f} (3 if the tracker's covariance is right)",
            f"trials                {summary.trials:9d}; intervals hold with 95 % confidence",
        ]
    )
