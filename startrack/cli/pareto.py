"""`startrack pareto`: what one goal costs in terms of another."""

from __future__ import annotations

import argparse

import numpy as np

from startrack.cli.exits import Exit, WrongUse
from startrack.cli.options import add_study, whole
from startrack.cli.study import open_study
from startrack.cli.terminal import finite, progress, tell
from startrack.design import DesignSpace
from startrack.io import save_json, save_text
from startrack.optimise import UNITS, Goals, front
from startrack.plots import draw_front


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack pareto`."""
    add_study(
        parser,
        "pareto",
        "Finds designs that no other beats in both goals, by the analytic budget, and tries each. "
        "Leaves front.md, front.png and result.json.",
    )
    for which, goal in (("first", "across"), ("second", "mass")):
        parser.add_argument(
            f"--{which}", default=goal, metavar="GOAL",
            help="across, about, both, about-99.73 and the like, mass, power, data rate, volume or "
            f"cost (default: {goal})",
        )  # fmt: skip
    parser.add_argument(
        "--points", type=whole(2, 1000), default=7, metavar="N", help="of the front (default: 7)"
    )
    parser.add_argument(
        "--method", choices=("epsilon", "weighted"), default="epsilon",
        help="least first goal under a limit on the second (default), or a weighted sum",
    )  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Leave front.md, front.png and result.json."""
    try:
        goals = Goals(options.first, options.second)
    except ValueError as error:
        raise WrongUse(str(error)) from None
    with (
        open_study(options, "trading goals of") as (case, campaign, bench, out),
        progress("designs", options.points) as advance,
    ):
        box = DesignSpace(case, campaign.variables, campaign.links)
        points = front(
            box, campaign, goals, bench, options.points, options.method, lambda _: advance(1)
        )
    units = [UNITS.get(goal, "arcsec") for goal in (goals.first, goals.second)]
    names = list(points[0].values)
    lines = [
        f"| {goals.first} ({units[0]}) expected | tried | {goals.second} ({units[1]}) expected "
        "| tried | " + " | ".join(name.split(".", 1)[1] for name in names) + " |",
        "|---" * (4 + len(names)) + "|",
    ]
    for one in points:
        texts = box.text(box.design(np.array(one.place))).values()
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
            {"values_si": one.values, "expected": one.expected, "tried": one.measured}
            for one in points
        ],
    }
    save_json(out / "result.json", finite(result))
    tell(options, result, f"{table}\n\nthe folder {out} holds it all")
    return Exit.DONE
