"""`startrack optimize`: a better design, found by search and checked by trials."""

from __future__ import annotations

import argparse
from typing import Any

from startrack.cli.options import Exit, Options, study, wanted

if wanted(__name__):
    from startrack import optimise
    from startrack.cli.campaign import open_campaign, stages, write_study
    from startrack.core import arcsec
    from startrack.design import Campaign, Design, save_design
    from startrack.metrics import Row, summary_rows, to_json
    from startrack.plots import draw_convergence


declare = Options(
    "Varies the variables of [campaign] under its requirements, and compares the best design with "
    "the start on fresh trials. Writes best.toml (a design for any other command), comparison.md, "
    "convergence.png, evaluations.csv, result.json, and ledger.sqlite, from which the same "
    "command continues after an interruption. Where no design is better than the start, the start "
    "stays, and the text says what stands in the way. The status is 3 if a requirement is not met. "
    "Of the scene of an Earth camera, by its file or name, it writes best.json in place of "
    "best.toml, and no evaluations.csv.",
    *study("optimize"),
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Write best.toml, comparison.md, convergence.png, evaluations.csv and result.json."""
    with (
        open_campaign(options, "optimising") as (case, campaign, runner),
        stages("optimising") as show,
    ):
        optimum = optimise.optimize(case, campaign, runner, watch_stage=show)
    table = optimise.comparison(optimum, campaign)
    note = f"found by startrack optimize, seed {options.seed}"
    save_design(options.out / "best.toml", Design(optimum.best, campaign), note)
    optimise.write_evaluations(options.out / "evaluations.csv", optimum.evaluations)
    draw_convergence(options.out / "convergence.png", optimum, campaign)
    result = {"out": str(options.out), "seed": options.seed, **optimum_values(optimum, campaign)}
    write_study(options, "comparison", table, result, f"the search ended: {optimum.ending}; ")
    return Exit.DONE if optimum.feasible else Exit.UNSOLVED


def optimum_values(optimum: optimise.Optimum, campaign: Campaign) -> dict[str, Any]:
    """An optimum for JSON."""
    space, available, units = optimum.space, optimum.availability, optimum.units
    ends = {"cost_start": optimum.start, "cost_best": optimum.best}
    costs = {name: campaign.cost(case) for name, case in ends.items()}
    costs = costs if campaign.minimise != "error" else {}
    return {
        "objective": str(campaign.goal),
        "minimise": campaign.minimise,
        **costs,
        "branch": optimum.branch,
        "start": to_json(summary_rows(optimum.fresh[0])),
        "best": to_json(summary_rows(optimum.fresh[1])),
        **to_json([Row("factor", optimum.factor), Row("optimism", optimum.optimism)]),
        "availability": available.value,
        "availability_bounds": [available.low, available.high],
        "values": space.text(optimum.best),
        "values_si": space.values(space.coordinates(optimum.best)),
        "on_bounds": space.on_bounds(optimum.best),
        "margins": optimum.margins,
        "lacking": optimum.lacking,
        "caveats": optimise.optimum_caveats(optimum, campaign),
        "evaluations": len(optimum.evaluations),
        "trials": optimum.trials,
        "errors_arcsec": {name: error / arcsec for name, error in optimum.errors.items()},
        "rounds": optimum.rounds,
        "feasible": optimum.feasible,
        "ending": optimum.ending,
        "start_stays": optimum.candidate is not None,
        **({"units": optimise.units_values(units)} if units else {}),
        **landscape_values(optimum),
    }


def landscape_values(optimum: optimise.Optimum) -> dict[str, Any]:
    """What the forecasts say of the space, for JSON."""
    landscape, space = optimum.landscape, optimum.space
    if landscape is None:
        return {}
    ends = {
        name: [space.values(end)[name] for end in (span.at_low, span.at_high)]
        for name, span in landscape.spans.items()
    }
    return {
        "forecasts": len(landscape.forecasts),
        "possible_gain": landscape.left,
        "spans_si": ends,
        "unimportant": landscape.unimportant,
        "prices": landscape.prices,
    }
