"""`startrack pareto`: what one goal costs in terms of another."""

from __future__ import annotations

import argparse

import numpy as np

from startrack.commands.study import open_study
from startrack.commands.terminal import finite, progress, tell
from startrack.draw_study import draw_front
from startrack.exits import Exit, WrongUse
from startrack.saving import save_json, save_text
from startrack.study.box import Box
from startrack.study.pareto import UNITS, Goals, front


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
        box = Box(case, campaign.variables, campaign.links)
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
