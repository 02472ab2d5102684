"""`startrack merge`: parts of a campaign, from several machines, as one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from startrack.cli.imports import wanted
from startrack.cli.options import Exit, WrongUse, as_wrong_use, describe

if wanted(__name__):
    from startrack.cli.terminal import finite, in_arcsec, print_message, print_result, progress
    from startrack.core import arcsec
    from startrack.io import regular_file
    from startrack.metrics import Interval
    from startrack.montecarlo import (
        Sketch,
        merge_sketches,
        merge_stores,
        save_sketch,
    )

FRACTIONS = (0.5, 0.6827, 0.9545, 0.9973, 0.9999, 0.999999)
SQLITE = b"SQLite format 3\0"


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack merge`."""
    describe(
        parser,
        "The parts are stores (`montecarlo --first K --trials N --store PART.sqlite`) or sketches "
        "(`--sketch PART.json`) of one campaign. The result has the same bytes in any order of the "
        "parts. Parts of another design, seed, sampling or version are refused. Trials that "
        "several stores have are kept once and reported, and refused where their outcomes differ; "
        "sketches with a trial in two of them are refused.",
    )
    parser.add_argument(
        "parts", type=Path, nargs="+", metavar="PART", help="stores, or sketches, of montecarlo"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="file to write, of the same kind"
    )


def command(options: argparse.Namespace) -> int:
    """Write the merged store or sketch; print how many trials it has."""
    with as_wrong_use(ValueError, OSError):
        kinds = {_is_store(path) for path in options.parts}
    if len(kinds) > 1:
        raise WrongUse("the parts must be all stores or all sketches, got both")
    if options.out in options.parts:
        raise WrongUse(f"--out must be another file than the parts, got {options.out}")
    parts = list(dict.fromkeys(options.parts))
    with progress("parts", len(parts)) as advance:
        if kinds.pop():
            return _stores(options, parts, advance)
        with as_wrong_use():
            sketch = merge_sketches(parts, advance)
    save_sketch(options.out, sketch)
    values, text = sketch_summary(sketch)
    print_result(options, {"merged": str(options.out), "parts": len(parts)} | values, text)
    return Exit.DONE


def _is_store(path: Path) -> bool:
    with open(regular_file(path, "a store or a sketch of montecarlo"), "rb") as file:
        return file.read(len(SQLITE)) == SQLITE


def _stores(options: argparse.Namespace, parts: list[Path], advance: Any) -> int:
    with as_wrong_use():
        merged = merge_stores(parts, options.out, advance)
    for first, end in merged.repeated:
        print_message(f"trials {first} to {end - 1} are in several parts, with equal outcomes")
    result = {
        "merged": str(options.out),
        "parts": len(parts),
        "trials": merged.trials,
        "repeated": [list(one) for one in merged.repeated],
    }
    print_result(options, result, f"{options.out}: {merged.trials} trials of {len(parts)} parts")
    return Exit.DONE


def sketch_summary(sketch: Sketch) -> tuple[dict[str, Any], str]:
    """A sketch for JSON, and as text, with 95 % confidence intervals."""
    values: dict[str, Any] = {"trials": sketch.trials, "ranges": [list(r) for r in sketch.ranges]}
    lines = [f"trials                {sketch.trials:9d}; intervals: 95 % confidence"]
    for which in ("across", "about"):
        found = in_arcsec(sketch.rms(which))
        values[f"{which}_rms_arcsec"] = found["value"]
        values[f"{which}_rms_arcsec_95"] = [found["low"], found["high"]]
        lines.append(f"{which} the boresight".ljust(22) + f"{_shown(found, 1)} arcsec rms")
    for name in ("availability", "false"):
        count = sketch.counts["correct" if name == "availability" else "false"]
        values[name] = count / sketch.trials
    there = sketch.availability
    values["availability_95"] = [there.low, there.high]
    percent = Interval(*(100 * one for one in (there.value, there.low, there.high)))
    lines.append(f"availability          {_shown(vars(percent), 1)} %")
    lines.append(f"false attitudes       {sketch.counts['false']:9d}")
    values["nees"] = sketch.mean("nees")
    lines.append(f"error^2 / variance    {values['nees']:9.3f} (3 expected)")
    values["quantiles"] = []
    for fraction in FRACTIONS:
        for name in ("across", "z"):
            found = in_arcsec(sketch.quantile(name, fraction))
            values["quantiles"].append({"of": name, "fraction": fraction} | found)
            text = "across" if name == "across" else "about"
            lines.append(f"{text:6s} {100 * fraction:10.6g} %   {_shown(found, 1)} arcsec")
    if sketch.counts["judged"]:
        error, trial = sketch.worst[0] / arcsec, -sketch.worst[1]
        values["worst"] = {"trial": trial, "across_arcsec": error}
        lines.append(f"largest error across  {error:9.3f} arcsec, in trial {trial}")
    return finite(values), "\n".join(lines)


def _shown(found: dict[str, float], unit: float) -> str:
    return f"{found['value'] / unit:9.4g} [{found['low'] / unit:.4g}, {found['high'] / unit:.4g}]"
