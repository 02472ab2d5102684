"""`startrack sweep`: errors, margins and costs of a design over the values of one or two keys."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import Exit, Option, Options, wanted, whole

if wanted(__name__):
    from startrack import optimise, plots
    from startrack.cli import terminal
    from startrack.cli.campaign import LEDGER, open_workers
    from startrack.cli.files import design_file
    from startrack.design import Fidelity
    from startrack.io import finite, save_csv, save_json
    from startrack.optimise import Ledger, TrialRunner

DESIGN_FILE = Option(
    "design DESIGN.toml",
    "design file, a scene of an Earth camera with [retrieval] and [campaign], or the name of a "
    "shipped file",
    Path,
)
SHARED = (
    Option("--log", "spacing of a range's values in equal ratios (default: in equal steps)"),
    shared.fidelity(
        "fidelity of the trials (default: the campaign's; without a campaign, window); frame, "
        "window, spots, covariance: see montecarlo"
    ),
    *shared.SET,
    shared.SEED,
    shared.WORKERS,
    *shared.SCHEDULER,
)
declare = Options(
    "Computes the design with each value of a key, or with each pair of values of two keys: "
    "errors, availability, margins of the requirements and costs by formula, as `requirements` "
    "and `budget`; with --trials errors, availability and their margins by trials, as "
    "`montecarlo`, on the same skies and noise at every value. A refused value is a row with the "
    "reason. Writes sweep.csv, sweep.png, result.json and ledger.sqlite, from which the same "
    "command continues. The status is 3 if a value is refused or has no attitude.\n\n startrack "
    "sweep nanosatellite instrument.optics.f_number=1.2..2.4\n startrack sweep mine.toml "
    "'instrument.detector.exposure=20..200 ms' --log --trials 1000\n startrack sweep "
    "balloon.toml scene.date=2026-08-21T12:00..2026-08-22T12:00\n startrack sweep mine.toml "
    "instrument.detector.product=imx174,cmv4000 \\\n 'instrument.optics.focal_length=16 mm,25 "
    "mm,35 mm'",
    DESIGN_FILE,
    Option(
        "keys KEY=A..B",
        "key of the design file and its values: A..B for a range, A,B,C for a list of numbers, "
        "names, files, products or dates; at most two",
        many="+",
    ),
    Option(
        "--points N",
        "number of values of a range (default: 9; 5 each for two keys)",
        whole(2, 1000),
    ),
    Option(
        "--trials N",
        "trials of each design in each of its conditions (default: none, by formula)",
        whole(0, 10**8),
        0,
    ),
    *SHARED,
    shared.out("startrack-sweep"),
    fidelity=None,
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Write sweep.csv, sweep.png and result.json; print the answer and the table."""
    with shared.as_wrong_use():
        count = optimise.swept_designs(options.keys, options.points)
    with opened(options) as (path, runner), terminal.progress("designs", count) as advance:
        swept = optimise.sweep(
            path,
            *options.keys,
            changes=options.set,
            points=options.points,
            log=options.log,
            trials=options.trials,
            fidelity=Fidelity(options.fidelity) if options.fidelity else None,
            runner=runner,
            progress=advance,
        )
    table = swept.columns
    save_csv(options.out / "sweep.csv", *swept.csv())
    plots.draw_sweep(options.out / "sweep.png", swept, path.stem)
    result: dict[str, Any] = {"design": str(options.design), "out": str(options.out)}
    result |= {"answer": swept.answer, "seed": options.seed, "by": swept.how, "rows": table.json()}
    save_json(options.out / "result.json", finite(result))
    refused = [f"{', '.join(row.values)}: {row.refused}" for row in swept.rows if row.refused]
    text = [swept.answer, "", *table.text(), "", *refused, f"by {swept.how}"]
    terminal.print_result(options, result, *text, f"results are in {options.out}")
    every = all(row.figures and not row.figures.note for row in swept.rows)
    return Exit.DONE if every else Exit.UNSOLVED


@contextmanager
def opened(options: argparse.Namespace) -> Iterator[tuple[Path, TrialRunner]]:
    """The path of the design, and the runner with workers and the ledger of the folder."""
    with shared.as_wrong_use():
        path = design_file(options.design)
        workers = open_workers(options)
        with workers as executor, Ledger(options.out / LEDGER) as ledger:
            yield path, TrialRunner(options.seed, executor, options.workers, ledger)
