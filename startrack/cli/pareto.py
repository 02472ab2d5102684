"""`startrack pareto`: the Pareto front of two goals."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

from startrack.cli.options import (
    Exit,
    Option,
    Options,
    WrongUse,
    as_wrong_use,
    study,
    wanted,
    whole,
)

if wanted(__name__):
    import numpy as np

    from startrack import plots
    from startrack.cli.campaign import open_runner, read_study, stages, unmet_text, write_study
    from startrack.design import COSTS, DesignSpace, Objective
    from startrack.metrics import markdown
    from startrack.optimise import FrontGoals, Point, front


FIRST, SECOND = "across", "mass"
GOALS = (
    "across, about, both, or a level such as about-99.73; mass, power, data rate, volume or cost; "
    "for a scene: objective (default), one of its parts, or an upper limit (default: the first)"
)
declare = Options(
    "Finds the Pareto front of two goals (no other design is better in both) by the analytic "
    "budget, and measures each of its designs by trials. Writes front.md, front.png and "
    "result.json.",
    *study("pareto"),
    Option("--first GOAL", f"first goal: {GOALS}", default=FIRST),
    Option("--second GOAL", f"second goal: {GOALS}", default=SECOND),
    Option("--points N", "number of designs on the front", whole(2, 1000), 7),
    Option(
        "--method",
        "minimise the first goal under a limit on the second (epsilon; default), "
        "or minimise a weighted sum of both",
        ("epsilon", "weighted"),
        "epsilon",
    ),
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Write front.md, front.png and result.json."""
    with as_wrong_use():
        goals = FrontGoals(options.first, options.second)
    opened = read_study(options)
    if unmet := unmet_text(opened):
        raise WrongUse(unmet)
    campaign = opened.campaign
    with (
        open_runner(options, opened, "trading off goals of") as runner,
        stages("trading off") as show,
    ):
        space = DesignSpace(opened.design.case, campaign.variables, campaign.links)
        points = front(space, campaign, goals, runner, options.points, options.method, show)
    named = (goals.first, goals.second)
    units = [COSTS.get(goal, "arcsec") for goal in named]
    words = [goal if goal in COSTS else str(Objective.read(goal)) for goal in named]
    texts = [space.text(space.design(np.array(point.coordinates))) for point in points]
    trials, labels = campaign.most_trials, list(space.labels().values())
    return write_front(options, points, named, words, units, texts, labels, trials)


def write_front(
    options: argparse.Namespace,
    points: Sequence[Point],
    goals: Sequence[str],
    words: Sequence[str],
    units: Sequence[str],
    texts: Sequence[Mapping[str, str]],
    labels: Sequence[str],
    trials: int,
) -> int:
    """Print and write a Pareto front.

    words   both goals in words
    texts   variables of each point
    labels  of the variables
    trials  of each point
    """
    head, rows = list[str](), []
    for goal, unit in zip(goals, units, strict=True):
        head += [f"{plots.with_unit(goal, unit)} expected", "tried"]
    for point, values in zip(points, texts, strict=True):
        pairs = zip(point.expected, point.measured, strict=True)
        rows.append([*(f"{value:.4g}" for pair in pairs for value in pair), *values.values()])
    ends = [
        " at ".join(f"{name} {value:.4g} {unit}".strip() for name, value, unit in figures)
        for figures in (
            list(zip(words, point.measured, units, strict=True))
            for point in (points[0], points[-1])
        )
    ]
    answer = front_words(len(points), *ends)
    table = "\n".join([answer, "", *markdown([*head, *labels], rows)])
    first, second = (plots.with_unit(word, unit) for word, unit in zip(words, units, strict=True))
    plots.draw_front(options.out / "front.png", points, (first, second), trials)
    found = [
        {
            "values_si": point.values,
            "expected": point.expected,
            "tried": point.measured,
            "tried_95": [[interval.low, interval.high] for interval in point.intervals],
        }
        for point in points
    ]
    result = {"out": str(options.out), "goals": list(goals), "points": found}
    write_study(options, "front", table, result)
    return Exit.DONE


def front_words(count: int, first: str, last: str) -> str:
    """Number of designs on a front, and the goals at its ends."""
    if count == 1:
        return f"1 design is the best by both goals, by trials: {first}"
    return f"{count} designs on the front, by trials: from {first} to {last}"
