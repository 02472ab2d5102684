"""`startrack pareto`: designs that no other beats in both of two goals."""

from __future__ import annotations

import argparse

from startrack.cli.imports import wanted
from startrack.cli.options import Exit, add_campaign_options, as_wrong_use, whole
from startrack.cli.scheduler import add_scheduler

if wanted(__name__):
    import numpy as np

    from startrack.cli.campaign import open_campaign
    from startrack.cli.terminal import finite, print_result, progress
    from startrack.design import DesignSpace
    from startrack.io import save_json, save_text
    from startrack.optimise import UNITS, Goals, front
    from startrack.plots import draw_front


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack pareto`."""
    add_campaign_options(
        parser,
        "pareto",
        "Finds designs that no other beats in both goals, by the analytic budget, and measures "
        "each by trials. Writes front.md, front.png and result.json.",
    )
    add_scheduler(parser)
    for which, goal in (("first", "across"), ("second", "mass")):
        parser.add_argument(
            f"--{which}", default=goal, metavar="GOAL",
            help=f"{which} goal: across, about, both, or a level such as about-99.73; mass, power, "
            f"data rate, volume or cost (default: {goal})",
        )  # fmt: skip
    parser.add_argument(
        "--points",
        type=whole(2, 1000),
        default=7,
        metavar="N",
        help="number of designs on the front (default: 7)",
    )
    parser.add_argument(
        "--method", choices=("epsilon", "weighted"), default="epsilon",
        help="minimise the first goal under a limit on the second (epsilon; default), or minimise "
        "a weighted sum of both",
    )  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Write front.md, front.png and result.json."""
    with as_wrong_use():
        goals = Goals(options.first, options.second)
    with (
        open_campaign(options, "trading off goals of") as (case, campaign, runner, out),
        progress("designs", options.points) as advance,
    ):
        space = DesignSpace(case, campaign.variables, campaign.links)
        points = front(
            space, campaign, goals, runner, options.points, options.method, lambda _: advance(1)
        )
    units = [UNITS.get(goal, "arcsec") for goal in (goals.first, goals.second)]
    names = list(points[0].values)
    lines = [
        f"| {goals.first} ({units[0]}) expected | tried | {goals.second} ({units[1]}) expected "
        "| tried | " + " | ".join(space.labels()[name] for name in names) + " |",
        "|---" * (4 + len(names)) + "|",
    ]
    for one in points:
        texts = space.text(space.design(np.array(one.coordinates))).values()
        pairs = zip(one.expected, one.measured, strict=True)
        goal = " | ".join(f"{expected:.4g} | {measured:.4g}" for expected, measured in pairs)
        lines.append(f"| {goal} | " + " | ".join(texts) + " |")
    table = "\n".join(lines)
    save_text(out / "front.md", table + "\n")
    draw_front(out / "front.png", points, goals, units, campaign.most_trials)
    result = {
        "out": str(out),
        "goals": [goals.first, goals.second],
        "points": [
            {
                "values_si": one.values,
                "expected": one.expected,
                "tried": one.measured,
                "tried_95": [[each.low, each.high] for each in one.intervals],
            }
            for one in points
        ],
    }
    save_json(out / "result.json", finite(result))
    print_result(options, result, f"{table}\n\nresults are in {out}")
    return Exit.DONE
