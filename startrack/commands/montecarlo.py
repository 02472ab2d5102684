"""`startrack montecarlo`: many trials of one design."""

from __future__ import annotations

import argparse
import time

from startrack.commands.terminal import (
    example,
    finite,
    progress,
    read_design,
    summary_text,
    summary_values,
    tell,
)
from startrack.draw import draw_errors
from startrack.error import summarise
from startrack.exits import Exit
from startrack.saving import save_json
from startrack.study.montecarlo import pool, run
from startrack.study.tables import write_outcomes


def command(options: argparse.Namespace) -> int:
    """Print the summary; with --out, leave trials.csv, errors.png and summary.json."""
    path = options.design or example()
    case = read_design(path).case
    with pool(options.workers) as executor, progress("trials", options.trials) as advance:
        began = time.perf_counter()
        outcomes = run(
            case,
            options.trials,
            options.seed,
            executor,
            workers=options.workers,
            progress=advance,
        )
        rate = options.trials / (time.perf_counter() - began)
    summary = summarise(outcomes)
    result = {"design": str(path), "seed": options.seed} | summary_values(summary)
    result |= {"trials_per_s": rate}
    if options.out:
        write_outcomes(options.out / "trials.csv", outcomes)
        draw_errors(options.out / "errors.png", outcomes, path.stem)
        save_json(options.out / "summary.json", finite(result))
        result["out"] = str(options.out)
    tell(options, result, f"{summary_text(summary)}\n{rate:.1f} trials/s, seed {options.seed}")
    return Exit.DONE if summary.availability.value == 1 else Exit.UNSOLVED
