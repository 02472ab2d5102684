"""`startrack sample`: how far each parameter may stray from a design."""

from __future__ import annotations

import argparse

from startrack.commands.study import open_study
from startrack.commands.terminal import finite, progress, tell
from startrack.draw_study import draw_tolerance
from startrack.exits import Exit
from startrack.saving import save_json, save_text
from startrack.study.sample import designs_needed, sample
from startrack.study.tables import tolerance_table, tolerance_values, write_samples


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
