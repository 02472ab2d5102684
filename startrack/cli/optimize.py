"""`startrack optimize`: a better design, found by search and checked by trials."""

from __future__ import annotations

import argparse

from startrack.cli.options import Exit, Option, Options, study, wanted

if wanted(__name__):
    from startrack import optimise, plots
    from startrack.cli.campaign import (
        ReadCampaign,
        open_runner,
        read_study,
        stages,
        unmet_text,
        write_study,
    )
    from startrack.cli.files import found_file
    from startrack.cli.terminal import example
    from startrack.design import Design, save_design, save_overlay
    from startrack.optimise import SearchStage
    from startrack.verification import cost_margins

LOG = "search.jsonl"


declare = Options(
    "Varies the variables of [campaign] under its requirements, and compares the best design "
    "with the start on fresh trials. Writes best.toml (a design for other commands), "
    "comparison.md, convergence.png, evaluations.csv, result.json, search.jsonl (a line for each "
    "forecast and each tried design, during the run), and ledger.sqlite, from which the same "
    "command continues after an interruption. If no design is better than the start, the start "
    "stays, and the text gives the reason. The status is 3 if a requirement is not met. For a "
    "scene of an Earth camera, by file or name, it writes best.json in place of best.toml, and "
    "no evaluations.csv.",
    *study("optimize"),
    Option(
        "--whole", "write best.toml with all values (default: the changes over the design file)"
    ),
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Write best.toml, comparison.md, convergence.png, evaluations.csv and result.json."""
    opened = read_study(options)
    design, campaign = opened.design, opened.campaign
    if unmet := unmet_text(opened):
        return _keep_start(options, opened, unmet)
    with (
        open_runner(options, opened, "optimising") as runner,
        stages("optimising") as show,
        optimise.SearchLog(options.out / LOG) as log,
    ):
        names = [variable.name for variable in campaign.variables]
        runner.watch = lambda case, foresight: log.forecast_of(case, foresight, names)

        def watch_stage(stage: SearchStage) -> None:
            log.stage(stage)
            show(stage)

        optimum = optimise.optimize(design.case, campaign, runner, log.tried, watch_stage)
    table = optimise.comparison(optimum, campaign)
    note = f"found by startrack optimize, seed {options.seed}"
    for unknown in design.undrawn:
        note += f"\nfound for the medians of unknown values: {unknown.name}, {unknown}"
    _save_best(options, Design(optimum.best, design.campaign, design.open_unknowns), note)
    optimise.write_evaluations(options.out / "evaluations.csv", optimum.evaluations)
    plots.draw_convergence(options.out / "convergence.png", optimum, campaign)
    result = {
        "out": str(options.out),
        "seed": options.seed,
        **optimise.optimum_values(optimum, campaign),
    }
    write_study(options, "comparison", table, result, f"the search ended: {optimum.ending}; ")
    return Exit.DONE if optimum.feasible else Exit.UNSOLVED


def _save_best(options: argparse.Namespace, design: Design, note: str) -> None:
    """Write best.toml."""
    path = options.out / "best.toml"
    if options.whole:
        save_design(path, design, note)
    else:
        save_overlay(path, design, found_file(options.campaign or example()), note)


def _keep_start(options: argparse.Namespace, opened: ReadCampaign, unmet: str) -> int:
    """Write the start as best.toml, and the cost limits that no design of the space can meet."""
    _save_best(options, opened.design, "the start of startrack optimize")
    result = {
        "out": str(options.out),
        "seed": options.seed,
        "feasible": False,
        "start_stays": True,
        "evaluations": 0,
        "trials": {},
        "margins": cost_margins(opened.campaign.requirements, opened.design.case),
        "ending": unmet,
    }
    text = f"No forecast was computed, and the result is the start: {unmet}."
    write_study(options, "comparison", text, result)
    return Exit.UNSOLVED
