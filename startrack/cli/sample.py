"""`startrack sample`: how far each parameter may stray from a design."""

from __future__ import annotations

import argparse

from startrack.cli.exits import Exit
from startrack.cli.options import add_study
from startrack.cli.study import open_study
from startrack.cli.terminal import finite, progress, tell
from startrack.io import save_json, save_text
from startrack.optimise import (
    designs_needed,
    sample,
    tolerance_table,
    tolerance_values,
    write_samples,
)
from startrack.plots import draw_tolerance


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack sample`."""
    add_study(
        parser,
        "sample",
        "Samples the designs around this one that keep its error, but for `margin`, and its "
        "requirements. Leaves tolerance.md, corner.png, samples.csv and result.json, or nothing "
        "and status 3 where the samples cannot be believed.",
    )


def command(options: argparse.Namespace) -> int:
    """Leave tolerance.md, corner.png, samples.csv and result.json.

    Chains that have not converged leave their doubt alone, and no numbers to be quoted.
    """
    with (
        open_study(options, "sampling around") as (case, campaign, bench, out),
        progress("designs", designs_needed(len(campaign.variables))) as advance,
    ):
        tolerance = sample(case, campaign, bench, lambda _: advance(1))
    values = tolerance_values(tolerance)
    if not tolerance.chains.converged:
        doubt = tolerance.chains.doubt
        tell(options, {"converged": False, "doubt": doubt}, f"not converged: {doubt}")
        return Exit.UNSOLVED
    table = tolerance_table(tolerance)
    save_text(out / "tolerance.md", table + "\n")
    write_samples(out / "samples.csv", tolerance)
    draw_tolerance(out / "corner.png", tolerance)
    result = {"out": str(out), "seed": options.seed, **values}
    save_json(out / "result.json", finite(result))
    tell(options, result, f"{table}\n\nthe folder {out} holds it all")
    return Exit.DONE
