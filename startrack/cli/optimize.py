"""`startrack optimize`: a better design, found by search and checked by trials."""

from __future__ import annotations

import argparse
from typing import Any

from startrack.cli.imports import wanted
from startrack.cli.options import Exit, add_campaign_options
from startrack.cli.scheduler import add_scheduler

if wanted(__name__):
    from startrack.cli.campaign import open_campaign
    from startrack.cli.terminal import finite, print_result, progress, summary_values
    from startrack.design import Campaign, Design, Objective, save_design
    from startrack.io import save_json, save_text
    from startrack.optimise import (
        Optimum,
        comparison,
        optimize,
        optimum_caveats,
        units_values,
        write_evaluations,
    )
    from startrack.plots import draw_convergence


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack optimize`."""
    add_campaign_options(
        parser,
        "optimize",
        "Varies the variables of [campaign] under its requirements, and compares the best design "
        "with the start on fresh trials. Writes best.toml (a design for any other command), "
        "comparison.md, convergence.png, evaluations.csv, result.json, and ledger.sqlite, from "
        "which the same command continues after an interruption. The status is 3 if a "
        "requirement is not met.",
    )
    add_scheduler(parser)


def command(options: argparse.Namespace) -> int:
    """Write best.toml, comparison.md, convergence.png, evaluations.csv and result.json."""
    with (
        open_campaign(options, "optimising") as (case, campaign, runner, out),
        progress("designs", campaign.evaluations) as advance,
    ):
        optimum = optimize(case, campaign, runner, lambda _: advance(1))
    table = comparison(optimum, campaign)
    note = f"found by startrack optimize, seed {options.seed}"
    save_design(out / "best.toml", Design(optimum.best, campaign), note)
    save_text(out / "comparison.md", table + "\n")
    write_evaluations(out / "evaluations.csv", optimum.evaluations)
    draw_convergence(out / "convergence.png", optimum, campaign.objective)
    result = {"out": str(out), "seed": options.seed, **optimum_values(optimum, campaign)}
    save_json(out / "result.json", finite(result))
    print_result(
        options,
        result,
        f"{table}\n\nthe search ended: {optimum.ending}; results are in {out}",
    )
    return Exit.DONE if optimum.feasible else Exit.UNSOLVED


def optimum_values(optimum: Optimum, campaign: Campaign) -> dict[str, Any]:
    """An optimum for JSON."""
    space, factor, optimism = optimum.space, optimum.factor, optimum.optimism
    return {
        "objective": str(Objective.read(campaign.objective)),
        "branch": optimum.branch,
        "start": summary_values(optimum.fresh[0]),
        "best": summary_values(optimum.fresh[1]),
        "factor": factor.value,
        "factor_95": [factor.low, factor.high],
        "optimism": optimism.value,
        "optimism_95": [optimism.low, optimism.high],
        "availability": optimum.availability.value,
        "availability_bounds": [optimum.availability.low, optimum.availability.high],
        "values": space.text(optimum.best),
        "values_si": space.values(space.coordinates(optimum.best)),
        "on_bounds": space.on_bounds(optimum.best),
        "margins": optimum.margins,
        "lacking": optimum.lacking,
        "caveats": optimum_caveats(optimum, campaign),
        "evaluations": len(optimum.evaluations),
        "trials": optimum.trials,
        "feasible": optimum.feasible,
        "ending": optimum.ending,
        **({"units": units_values(optimum.units)} if optimum.units else {}),
    }
