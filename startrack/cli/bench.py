"""`startrack bench`: the CPU time and the error of every stage, on this machine."""

from __future__ import annotations

import argparse

import cv2

from startrack.benchmark import STAGES, draw_benchmark, markdown, measure, values, versions
from startrack.cli.options import Exit, add_out, describe
from startrack.cli.terminal import print_message, print_result
from startrack.io import save_json, save_text


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack bench`."""
    describe(parser, "Writes bench.md, bench.json and bench.png.")
    parser.add_argument(
        "stages", nargs="*", type=stage, metavar="STAGE",
        help=f"stages to measure: {', '.join(STAGES)} (default: all, which takes some minutes)",
    )  # fmt: skip
    add_out(parser, "startrack-bench")


def stage(text: str) -> str:
    """Read the name of a stage."""
    if text not in STAGES:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(STAGES)}, got {text!r}")
    return text


def command(options: argparse.Namespace) -> int:
    """Write bench.md, bench.json and bench.png."""
    cv2.setNumThreads(1)
    stages, rows = [], []
    for name in options.stages or STAGES:
        print_message(f"{name} ...")
        stages.append(STAGES[name]())
        rows += measure(stages[-1])
    text = f"{versions()}\n\n{markdown(stages, rows)}"
    table, data, picture = (options.out / f"bench.{kind}" for kind in ("md", "json", "png"))
    save_text(table, text)
    save_json(data, values(stages, rows))
    draw_benchmark(picture, stages, rows)
    print_result(options, values(stages, rows), f"{text}\nwrote {table}, {data} and {picture}")
    return Exit.DONE
