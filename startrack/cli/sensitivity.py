"""`startrack sensitivity`: which parameters the error of a design depends on."""

from __future__ import annotations

import argparse
import math

from startrack.cli.imports import wanted
from startrack.cli.options import Exit, add_campaign_options, power_of_two
from startrack.cli.scheduler import add_scheduler

if wanted(__name__):
    from startrack.cli.campaign import open_campaign
    from startrack.cli.terminal import finite, print_result
    from startrack.design import DesignSpace, Objective
    from startrack.io import save_json, save_text
    from startrack.optimise import Sensitivity, sensitivities, units_text
    from startrack.plots import draw_tornado


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack sensitivity`."""
    add_campaign_options(
        parser,
        "sensitivity",
        "Computes by the analytic budget the error with each variable at its bounds, its slope, "
        "and its Sobol indices over the ranges of all variables. Writes sensitivity.md, "
        "tornado.png and result.json.",
    )
    add_scheduler(parser)
    parser.add_argument(
        "--designs", type=power_of_two, default=64, metavar="N",
        help="number of base designs of the Sobol indices, a power of two (default: 64)",
    )  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Write sensitivity.md, tornado.png and result.json, all by the analytic budget."""
    with open_campaign(options, "computing the sensitivities of") as (case, campaign, _, out):
        space = DesignSpace(case, campaign.variables, campaign.links)
        found = sensitivities(space, campaign, options.seed, options.designs)
    over = campaign.over_units(case)
    objective = units_text(over, campaign) if over else str(Objective.read(campaign.objective))
    table = _table(found, objective, space.labels())
    save_text(out / "sensitivity.md", table + "\n")
    draw_tornado(out / "tornado.png", found, objective)
    result = {
        "out": str(out),
        "objective": objective,
        "variables": {
            one.name: {
                "low_arcsec": one.low,
                "high_arcsec": one.high,
                "slope": one.slope,
                "first": one.first.value,
                "first_95": [one.first.low, one.first.high],
                "total": one.total.value,
                "total_95": [one.total.low, one.total.high],
            }
            for one in found
        },
    }
    save_json(out / "result.json", finite(result))
    print_result(options, result, f"{table}\n\nresults are in {out}")
    return Exit.DONE


def _table(found: list[Sensitivity], objective: str, labels: dict[str, str]) -> str:
    lines = [
        f"| variable | {objective} at its bounds (arcsec) | d ln error / d ln variable "
        "| first-order index | total index |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {labels[one.name]} | {_text(one.low)} to {_text(one.high)} | {one.slope:+.2f} "
        f"| {one.first.value:.2f} [{one.first.low:.2f}, {one.first.high:.2f}] "
        f"| {one.total.value:.2f} [{one.total.low:.2f}, {one.total.high:.2f}] |"
        for one in found
    ]
    lines += ["", "Sobol indices of ln(error) over the ranges of the variables, by the analytic "
              "budget, with 95 % bootstrap intervals."]  # fmt: skip
    return "\n".join(lines)


def _text(error: float) -> str:
    return f"{error:.3f}" if math.isfinite(error) else "no attitude"
