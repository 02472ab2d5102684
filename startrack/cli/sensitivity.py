"""`startrack sensitivity`: which parameters the error of a design depends on."""

from __future__ import annotations

import argparse
import math

from startrack.cli.exits import Exit
from startrack.cli.options import add_study, power_of_two
from startrack.cli.study import open_study
from startrack.cli.terminal import finite, tell
from startrack.design import DesignSpace, Objective
from startrack.io import save_json, save_text
from startrack.optimise import Sensitivity, sensitivities
from startrack.plots import draw_tornado


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack sensitivity`."""
    add_study(
        parser,
        "sensitivity",
        "By the analytic budget: the error with each variable at its bounds, its slope, and its "
        "Sobol indices over the box. Leaves sensitivity.md, tornado.png and result.json.",
    )
    parser.add_argument(
        "--designs", type=power_of_two, default=64, metavar="N",
        help="base designs of the Sobol indices, a power of two (default: 64)",
    )  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Leave sensitivity.md, tornado.png and result.json; all is by the analytic budget."""
    with open_study(options, "asking for the sensitivities of") as (case, campaign, _, out):
        box = DesignSpace(case, campaign.variables, campaign.links)
        found = sensitivities(box, campaign, options.seed, options.designs)
    objective = str(Objective.read(campaign.objective))
    table = _table(found, objective)
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
    tell(options, result, f"{table}\n\nthe folder {out} holds it all")
    return Exit.DONE


def _table(found: list[Sensitivity], objective: str) -> str:
    lines = [
        f"| variable | {objective} at its bounds (arcsec) | d ln error / d ln variable "
        "| first-order index | total index |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {one.name.split('.', 1)[1]} | {_told(one.low)} to {_told(one.high)} | {one.slope:+.2f} "
        f"| {one.first.value:.2f} [{one.first.low:.2f}, {one.first.high:.2f}] "
        f"| {one.total.value:.2f} [{one.total.low:.2f}, {one.total.high:.2f}] |"
        for one in found
    ]
    lines += ["", "Sobol indices of ln(error) over the box, by the analytic budget, with their "
              "95 % bootstrap intervals."]  # fmt: skip
    return "\n".join(lines)


def _told(error: float) -> str:
    return f"{error:.3f}" if math.isfinite(error) else "no attitude"
