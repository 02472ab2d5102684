"""`startrack optimize`: a better design."""

from __future__ import annotations

import argparse

from startrack.commands.terminal import (
    example,
    finite,
    progress,
    read_campaign,
    say,
    summary_values,
    tell,
)
from startrack.design import Design, save_design
from startrack.draw import draw_convergence
from startrack.exits import Exit, WrongUse
from startrack.saving import save_json, save_text
from startrack.study.box import Box
from startrack.study.montecarlo import pool
from startrack.study.optimize import Evaluation, optimize
from startrack.study.tables import comparison, evaluation_line, write_evaluations


def command(options: argparse.Namespace) -> int:
    """Leave best.toml, comparison.md, convergence.png, evaluations.csv and result.json."""
    path = options.campaign or example()
    design, campaign = read_campaign(path)
    try:
        box = Box(design.case, campaign.variables)
    except ValueError as error:
        raise WrongUse(f"{path}: {error}") from None
    out = options.out
    say(f"optimising {path.stem} on {options.workers} workers; results go to {out}")
    out.mkdir(parents=True, exist_ok=True)
    with (
        pool(options.workers) as executor,
        (out / "evaluations.jsonl").open("w", encoding="utf-8") as log,
        progress("designs", campaign.evaluations) as advance,
    ):
        # Each design is on disk before the next is tried: a run that is cut short loses nothing.
        def watch(done: Evaluation) -> None:
            log.write(evaluation_line(done) + "\n")
            log.flush()
            advance(1)

        optimum = optimize(design.case, campaign, options.seed, executor, options.workers, watch)
    table = comparison(optimum, box, campaign)
    note = f"found by startrack optimize, seed {options.seed}"
    save_design(out / "best.toml", Design(optimum.best, campaign), note)
    save_text(out / "comparison.md", table + "\n")
    write_evaluations(out / "evaluations.csv", optimum.evaluations)
    draw_convergence(out / "convergence.png", optimum, box, campaign.objective)
    factor = optimum.factor
    result = {
        "out": str(out),
        "seed": options.seed,
        "objective": f"rms error {campaign.objective} the boresight",
        "start": summary_values(optimum.fresh[0]),
        "best": summary_values(optimum.fresh[1]),
        "factor": factor.value,
        "factor_95": [factor.low, factor.high],
        "values": box.text(optimum.best),
        "values_si": box.values(box.place(optimum.best)),
        "margins": campaign.requirements.margins(optimum.best),
        "evaluations": len(optimum.evaluations),
        "feasible": optimum.feasible,
        "ending": optimum.ending,
    }
    save_json(out / "result.json", finite(result))
    tell(options, result, f"{table}\n\n{optimum.ending}; the folder {out} holds it all")
    return Exit.DONE if optimum.feasible else Exit.UNSOLVED
