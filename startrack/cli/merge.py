"""`startrack montecarlo merge`: parts of a campaign, from several machines, as one."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from startrack.cli.options import Exit, Option, Options, WrongUse, as_wrong_use, wanted, whole

if wanted(__name__):
    from startrack import montecarlo
    from startrack.cli.terminal import print_message, print_result, print_rows, progress
    from startrack.core import arcsec
    from startrack.io import regular_file
    from startrack.metrics import ARCSEC, PERCENT, PURE, Row, bounds_json

FRACTIONS = (0.5, 0.6827, 0.9545, 0.9973, 0.9999, 0.999999)
SQLITE = b"SQLite format 3\0"


declare = Options(
    "The parts are stores (`montecarlo --first K --trials N --store PART.sqlite`) or sketches "
    "(`--sketch PART.json`) of one campaign. The result has the same bytes in any order of the "
    "parts. Parts of another design, seed, sampling or version are refused. Trials in several "
    "stores are kept once and reported; different outcomes are refused. Sketches with a common "
    "trial are refused. Missing trials, from number 0 on, are refused without --partial.",
    Option("parts PART", "stores, or sketches, of montecarlo", Path, many="+"),
    Option("--out FILE", "file to write, of the same kind", Path, required=True),
    Option(
        "--partial",
        "accept missing trials, for example of a lost job; their numbers are in the result",
    ),
    Option(
        "--trials N",
        "trials of the whole campaign, whose last part may be missing (default: trials of the "
        "parts)",
        whole(1),
    ),
)


def command(options: argparse.Namespace) -> int:
    """Write the merged store or sketch; print how many trials it has."""
    with as_wrong_use(ValueError, OSError):
        kinds = set()
        for path in options.parts:
            with open(regular_file(path, "a store or a sketch of montecarlo"), "rb") as file:
                kinds.add(file.read(len(SQLITE)) == SQLITE)
    if len(kinds) > 1:
        raise WrongUse("the parts must be all stores or all sketches, got both")
    if options.out in options.parts:
        raise WrongUse(f"--out must be another file than the parts, got {options.out}")
    parts = list(dict.fromkeys(options.parts))
    with progress("parts", len(parts)) as advance:
        if kinds.pop():
            return _stores(options, parts, advance)
        with as_wrong_use():
            sketch = montecarlo.merge_sketches(parts, advance, options.partial, options.trials)
    montecarlo.save_sketch(options.out, sketch)
    missing = montecarlo.missing_runs(sketch.ranges, options.trials)
    _say_missing(missing)
    rows = [
        Row("merged", str(options.out)),
        Row("parts", len(parts)),
        Row("missing", [list(numbers) for numbers in missing]),
        *sketch_rows(sketch),
    ]
    print_rows(options, rows)
    return Exit.DONE


def _stores(options: argparse.Namespace, parts: list[Path], advance: Any) -> int:
    with as_wrong_use():
        merged = montecarlo.merge_stores(
            parts, options.out, advance, options.partial, options.trials
        )
    _say_missing(merged.missing)
    for first, end in merged.repeated:
        print_message(f"trials {first} to {end - 1} are in several parts, with equal outcomes")
    result = {
        "merged": str(options.out),
        "parts": len(parts),
        "trials": merged.trials,
        "repeated": [list(numbers) for numbers in merged.repeated],
        "missing": [list(numbers) for numbers in merged.missing],
    }
    print_result(options, result, f"{options.out}: {merged.trials} trials of {len(parts)} parts")
    return Exit.DONE


def _say_missing(missing: Sequence[tuple[int, int]]) -> None:
    for first, end in missing:
        print_message(f"trials {first} to {end - 1} are missing: no part has them")


def sketch_rows(sketch: montecarlo.Sketch) -> list[Row]:
    """Figures of a sketch, with 95 % confidence intervals."""
    there, false = sketch.availability, sketch.counts["false"]
    rows = [
        Row("trials", sketch.trials, "trials", PURE, "d", "(intervals: 95 % confidence)"),
        Row("ranges", [list(numbers) for numbers in sketch.ranges]),
        *(
            Row(
                f"{name}_rms_arcsec",
                sketch.rms(name),
                f"{name} the boresight",
                ARCSEC,
                ".4g",
                "rms",
            )
            for name in ("across", "about")
        ),
        Row("availability", sketch.counts["correct"] / sketch.trials),
        Row("false", false / sketch.trials, "false attitudes", PERCENT, ".4g"),
        Row("availability_95", [there.low, there.high]),
        Row("", there, "availability", PERCENT, ".4g"),
        Row("nees", sketch.mean("nees"), "error^2 / variance", note="(3 expected)"),
    ]
    levels = {(part, of): sketch.quantile(of, part) for part in FRACTIONS for of in ("across", "z")}
    of_json = [
        {"of": of, "fraction": part} | bounds_json(level, ARCSEC)
        for (part, of), level in levels.items()
    ]
    rows.append(Row("quantiles", of_json))
    for (part, of), level in levels.items():
        label = f"{'about' if of == 'z' else of}, {100 * part:.6g} % below"
        rows.append(Row("", level, label, ARCSEC, ".4g"))
    if sketch.counts["judged"]:
        error, trial = sketch.worst[0], -sketch.worst[1]
        rows.append(Row("worst", {"trial": trial, "across_arcsec": error / arcsec}))
        rows.append(Row("", error, "largest error across", ARCSEC, note=f"in trial {trial}"))
    return rows
