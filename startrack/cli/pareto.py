"""`startrack pareto`: designs that no other beats in both of two goals."""

from __future__ import annotations

import argparse

from startrack.cli.options import Exit, Option, Options, as_wrong_use, study, wanted, whole

if wanted(__name__):
    import numpy as np

    from startrack.cli.campaign import open_campaign, stages, write_study
    from startrack.design import COSTS, DesignSpace
    from startrack.metrics import markdown
    from startrack.optimise import FrontGoals, front
    from startrack.plots import draw_front


GOALS = (
    "across, about, both, or a level such as about-99.73; mass, power, data rate, volume or cost"
)
declare = Options(
    "Finds designs that no other beats in both goals, by the analytic budget, and measures each "
    "by trials. Writes front.md, front.png and result.json.",
    *study("pareto"),
    Option("--first GOAL", f"first goal: {GOALS}", default="across"),
    Option("--second GOAL", f"second goal: {GOALS}", default="mass"),
    Option("--points N", "number of designs on the front", whole(2, 1000), 7),
    Option(
        "--method",
        "minimise the first goal under a limit on the second (epsilon; default), "
        "or minimise a weighted sum of both",
        ("epsilon", "weighted"),
        "epsilon",
    ),
)


def command(options: argparse.Namespace) -> int:
    """Write front.md, front.png and result.json."""
    with as_wrong_use():
        goals = FrontGoals(options.first, options.second)
    with (
        open_campaign(options, "trading off goals of") as (case, campaign, runner),
        stages("trading off") as show,
    ):
        space = DesignSpace(case, campaign.variables, campaign.links)
        points = front(space, campaign, goals, runner, options.points, options.method, show)
    named = (goals.first, goals.second)
    units = [COSTS.get(goal, "arcsec") for goal in named]
    head, rows = list[str](), []
    for goal, unit in zip(named, units, strict=True):
        head += [f"{goal} ({unit}) expected", "tried"]
    for point in points:
        pairs = zip(point.expected, point.measured, strict=True)
        values = space.text(space.design(np.array(point.coordinates))).values()
        rows.append([*(f"{value:.4g}" for pair in pairs for value in pair), *values])
    table = "\n".join(markdown([*head, *space.labels().values()], rows))
    draw_front(options.out / "front.png", points, goals, units, campaign.most_trials)
    found = [
        {
            "values_si": point.values,
            "expected": point.expected,
            "tried": point.measured,
            "tried_95": [[interval.low, interval.high] for interval in point.intervals],
        }
        for point in points
    ]
    result = {"out": str(options.out), "goals": list(named), "points": found}
    write_study(options, "front", table, result)
    return Exit.DONE
