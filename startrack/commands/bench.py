"""`startrack bench`: the CPU time and the error of every stage, on this machine."""

from __future__ import annotations

import argparse

import cv2

from startrack.benchmark import STAGES, draw_benchmark, markdown, measure, values, versions
from startrack.commands.terminal import say, tell
from startrack.exits import Exit
from startrack.saving import save_json, save_text


def command(options: argparse.Namespace) -> int:
    """Write bench.md, bench.json and bench.png."""
    cv2.setNumThreads(1)
    stages, rows = [], []
    for name in options.stages or STAGES:
        say(f"{name} ...")
        stages.append(STAGES[name]())
        rows += measure(stages[-1])
    text = f"{versions()}\n\n{markdown(stages, rows)}"
    table, data, picture = (options.out / f"bench.{kind}" for kind in ("md", "json", "png"))
    save_text(table, text)
    save_json(data, values(stages, rows))
    draw_benchmark(picture, stages, rows)
    tell(options, values(stages, rows), f"{text}\nwrote {table}, {data} and {picture}")
    return Exit.DONE
