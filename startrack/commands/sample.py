"""`startrack sample`: how far each parameter may stray from a design."""

from __future__ import annotations

import argparse

from startrack.commands.terminal import (
    example,
    finite,
    progress,
    read_campaign,
    say,
    tell,
)
from startrack.draw import draw_corner
from startrack.exits import Exit
from startrack.saving import save_json, save_text
from startrack.study.montecarlo import pool
from startrack.study.sample import designs_needed, sample
from startrack.study.tables import tolerance_table, tolerance_values, write_samples


def command(options: argparse.Namespace) -> int:
    """Leave tolerance.md, corner.png, samples.csv and result.json."""
    path = options.campaign or example()
    design, campaign = read_campaign(path)
    out = options.out
    say(f"sampling around {path.stem} on {options.workers} workers; results go to {out}")
    with (
        pool(options.workers) as executor,
        progress("designs", designs_needed(len(campaign.variables))) as advance,
    ):
        tolerance = sample(
            design.case, campaign, options.seed, executor, options.workers, lambda _: advance(1)
        )
    table = tolerance_table(tolerance)
    save_text(out / "tolerance.md", table + "\n")
    write_samples(out / "samples.csv", tolerance)
    draw_corner(out / "corner.png", tolerance)
    result = {"out": str(out), "seed": options.seed, **tolerance_values(tolerance)}
    save_json(out / "result.json", finite(result))
    tell(options, result, f"{table}\n\nthe folder {out} holds it all")
    return Exit.DONE if tolerance.converged else Exit.UNSOLVED
