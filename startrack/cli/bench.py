"""`startrack tools bench`: the CPU time and the error of every stage, on this machine."""

from __future__ import annotations

import argparse

from startrack.cli.options import Exit, Option, Options, as_wrong_use, out, wanted

if wanted(__name__):
    import cv2

    from startrack.benchmark import STAGES, draw_benchmark, markdown, measure, values, versions
    from startrack.cli.terminal import print_message, print_result
    from startrack.core import one_of
    from startrack.io import save_json, save_text


declare = Options(
    "Writes bench.md, bench.json and bench.png.",
    Option(
        "stages STAGE",
        "stages to measure: psf, stamping, noise, frame, detection, quick-detection, "
        "centroid, identification, attitude, terrain, radiance, montecarlo, optimiser (default: "
        "all, which takes some minutes)",
        many="*",
    ),
    out("startrack-bench"),
)


def command(options: argparse.Namespace) -> int:
    """Write bench.md, bench.json and bench.png."""
    with as_wrong_use():
        for name in options.stages:
            one_of(STAGES, stage=name)
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
