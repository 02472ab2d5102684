"""`startrack sequence`: a tracker followed in time."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from startrack.campaign.export import export
from startrack.catalog import shipped
from startrack.commands.terminal import (
    example,
    finite,
    in_arcsec,
    progress,
    read_design,
    read_sequence,
    tell,
)
from startrack.draw_sequence import draw_sequence
from startrack.error import Interval
from startrack.exits import Exit
from startrack.saving import save_json
from startrack.sequence import Tracking, fly, summarise
from startrack.study.workers import pool
from startrack.units import arcsec


def command(options: argparse.Namespace) -> int:
    """Print accuracy, losses and reacquisitions; leave frames.csv, sequence.png, summary.json."""
    design = options.design or example()
    profile = options.profile or shipped("sequences/slew.toml")
    case, sequence = read_design(design).case, read_sequence(profile)
    with (
        pool(min(options.workers, options.sequences)) as executor,
        progress("sequences", options.sequences) as advance,
    ):
        table = fly(case, sequence, options.sequences, options.seed, executor, advance)
    tracking = summarise(table)
    result = {"design": str(design), "profile": str(profile), "seed": options.seed}
    result |= _values(tracking) | {"frames": len(table), "out": str(options.out)}
    export(options.out / "frames.csv", table)
    first = table[table["sequence"] == 0]
    title = f"{Path(design).stem}, {Path(profile).stem}: sequence 1 of {options.sequences}"
    draw_sequence(options.out / "sequence.png", first, title)
    save_json(options.out / "summary.json", finite(result))
    tell(options, result, _text(tracking, len(table)))
    return Exit.DONE if tracking.known.value == 1 else Exit.UNSOLVED


def _values(tracking: Tracking) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for field in dataclasses.fields(tracking):
        one = getattr(tracking, field.name)
        if not isinstance(one, Interval):
            values[field.name] = one
            continue
        angle = field.name in ("across", "about", "single")
        told = in_arcsec(one) if angle else dataclasses.asdict(one)
        name = f"{field.name}_rms_arcsec" if angle else field.name
        values |= {name: told["value"], f"{name}_95": [told["low"], told["high"]]}
    return values


def _text(tracking: Tracking, frames: int) -> str:
    lines = []
    for title, one, unit, size in (
        ("filter across the boresight", tracking.across, "arcsec rms per axis", arcsec),
        ("filter about the boresight", tracking.about, "arcsec rms", arcsec),
        ("frames alone, across", tracking.single, "arcsec rms per axis", arcsec),
        ("attitude known", tracking.known, "% of the frames", 0.01),
        ("losses of track", tracking.losses_per_hour, "per hour", 1.0),
        ("from loss to attitude", tracking.reacquisition, "s", 1.0),
    ):
        value, low, high = (bound / size for bound in (one.value, one.low, one.high))
        lines.append(f"{title:28s}{value:10.3f} {unit} [{low:.3f}, {high:.3f}]")
    return "\n".join(
        [
            *lines,
            f"{frames} frames in {tracking.sequences} sequences; intervals hold with 95 % "
            "confidence, infinite where one sequence tells no scatter",
        ]
    )
