"""`startrack report`: a campaign as a self-contained HTML page."""

from __future__ import annotations

import argparse
from pathlib import Path

from startrack.cli.options import (
    ALLOW_CODE,
    SEED,
    WORKERS,
    Exit,
    Option,
    Options,
    as_wrong_use,
    wanted,
    whole,
)

if wanted(__name__):
    from startrack.cli.terminal import print_result, progress
    from startrack.io import save_text
    from startrack.montecarlo import Store, one_thread
    from startrack.report import Depth, repeated, write_report


declare = Options(
    "The page has the design, a verdict on each requirement, the summary, causes of lost trials, "
    "distributions, maps of the sky, error budget, error over magnitude, field and slew rate, "
    "fidelities, the worst trials with their frames, and all inputs. Some trials are repeated "
    "for the page; their number determines the time.",
    Option(
        "campaign CAMPAIGN.sqlite", "store of `montecarlo`, or a scene of an Earth camera", Path
    ),
    Option("--out FILE.html", "page to write (default: beside the campaign)", Path),
    Option("--title TEXT", "title of the page (default: the name of the campaign)"),
    Option("--author NAME", "author, for the head of the page", default=""),
    ALLOW_CODE,
    Option("--trials N", "trials of a scene's camera for the page", whole(2), 400),
    SEED,
    WORKERS,
    Option("--stars N", "trials with measurements of single stars", whole(1), 60),
    Option("--slews N", "trials at each of seven slew rates", whole(1), 60),
    Option("--budget N", "trials for the measured error budget", whole(2), 60),
    Option("--fidelity-trials N", "trials at each fidelity, for comparison", whole(2), 60),
    Option("--worst N", "worst trials to show with their frames", whole(0), 3),
    Option("--conditions N", "trials in each further condition of the verdict", whole(2), 200),
    Option("--rungs", argparse.SUPPRESS, whole(2), dest="fidelity_trials"),
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Write the page."""
    one_thread()
    path = options.out or options.campaign.with_suffix(".html")
    title = options.title or f"Campaign {options.campaign}"
    with as_wrong_use():
        depth = Depth(
            options.stars,
            options.slews,
            options.budget,
            options.fidelity_trials,
            options.worst,
            options.conditions,
        )
        store = Store(options.campaign)
        store.require_inputs()
    with store, progress("trials repeated", repeated(store, depth)) as advance:
        html = write_report(store, title, depth, advance, options.author)
        trials = len(store.outcomes())
    save_text(path, html)
    size = len(html.encode())
    result = {"report": str(path), "trials": trials, "bytes": size}
    print_result(options, result, f"{path}: {trials} trials, {size / 1e6:.1f} MB")
    return Exit.DONE
