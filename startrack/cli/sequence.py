"""`startrack sequence`: a tracker in time."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from startrack.cli.imports import wanted
from startrack.cli.options import Exit, add_design, add_out, add_seed, add_workers, describe, whole

if wanted(__name__):
    from startrack.cli.terminal import (
        example,
        finite,
        in_arcsec,
        print_result,
        progress,
        read_design,
        read_sequence,
    )
    from startrack.core import arcsec
    from startrack.io import save_json, shipped
    from startrack.metrics import Interval
    from startrack.montecarlo import export, pool
    from startrack.plots import draw_sequence
    from startrack.sequence import Recording, Tracking, fly_sequences, summarise_sequences


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack sequence`."""
    describe(
        parser,
        "Simulates a profile frame by frame, from random attitudes, and prints the errors of the "
        "filter beside those of single frames. Writes frames.csv, sequence.png and summary.json. "
        "The status is 3 if the attitude was not known after each frame.",
    )
    add_design(parser)
    parser.add_argument(
        "--profile", type=Path, metavar="PROFILE.toml",
        help="file with the legs of the attitude profile, frame rate and gyroscope (default: the "
        "example, catalogs/sequences/slew.toml, with a slew too fast for an attitude)",
    )  # fmt: skip
    parser.add_argument(
        "--sequences", type=whole(1), default=8, metavar="N",
        help="number of sequences, from random attitudes (default: 8)",
    )  # fmt: skip
    parser.add_argument(
        "--frames", choices=("fits", "png", "ser", "raw", "mkv"),
        help="keep the frames of all sequences in the folder frames: FITS with WCS, 16-bit PNG, "
        "SER, raw, or lossless video (mkv), and a table of their times and true attitudes for each "
        "sequence",
    )  # fmt: skip
    add_seed(parser)
    add_workers(parser)
    add_out(parser, "startrack-sequence")


def command(options: argparse.Namespace) -> int:
    """Print accuracy, losses and reacquisitions; write frames.csv, sequence.png, summary.json."""
    design = options.design or example()
    profile = options.profile or shipped("sequences/slew.toml")
    case, sequence = read_design(design, options.set).case, read_sequence(profile)
    recording = Recording(options.out / "frames", options.frames) if options.frames else None
    with (
        pool(min(options.workers, options.sequences)) as executor,
        progress("sequences", options.sequences) as advance,
    ):
        table = fly_sequences(
            case, sequence, options.sequences, options.seed, executor, advance, recording
        )
    tracking = summarise_sequences(table)
    result = {"design": str(design), "profile": str(profile), "seed": options.seed}
    result |= _values(tracking) | {"frames": len(table), "out": str(options.out)}
    export(options.out / "frames.csv", table)
    first = table[table["sequence"] == 0]
    title = f"{Path(design).stem}, {Path(profile).stem}: sequence 1 of {options.sequences}"
    draw_sequence(options.out / "sequence.png", first, title)
    save_json(options.out / "summary.json", finite(result))
    print_result(options, result, _text(tracking, len(table)))
    return Exit.DONE if tracking.known.value == 1 else Exit.UNSOLVED


def _values(tracking: Tracking) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for field in dataclasses.fields(tracking):
        one = getattr(tracking, field.name)
        if not isinstance(one, Interval):
            values[field.name] = one
            continue
        angle = field.name in ("across", "about", "single")
        bounds = in_arcsec(one) if angle else dataclasses.asdict(one)
        name = f"{field.name}_rms_arcsec" if angle else field.name
        values |= {name: bounds["value"], f"{name}_95": [bounds["low"], bounds["high"]]}
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
            f"{frames} frames in {tracking.sequences} sequences; intervals: 95 % confidence, "
            "infinite if there is one sequence only",
        ]
    )
