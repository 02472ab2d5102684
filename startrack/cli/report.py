"""`startrack report`: a campaign as one self-contained HTML page."""

from __future__ import annotations

import argparse
from pathlib import Path

from startrack.cli.imports import wanted
from startrack.cli.options import Exit, add_allow_code, as_wrong_use, describe, whole

if wanted(__name__):
    from startrack.cli.terminal import print_result, progress
    from startrack.io import save_text
    from startrack.montecarlo import Store, one_thread
    from startrack.report import Depth, repeated, write_report


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack report`."""
    describe(
        parser,
        "The page has the design, a verdict on each requirement, the summary, causes of lost "
        "trials, distributions, maps of the sky, error budget, error over magnitude, field and "
        "slew rate, fidelities, the worst trials with their frames, and all inputs. "
        "Some trials are repeated for it; their numbers set the time.",
    )
    parser.add_argument(
        "campaign", type=Path, metavar="CAMPAIGN.sqlite", help="store of `montecarlo`"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.html", help="page to write (default: beside the campaign)"
    )
    parser.add_argument(
        "--title", metavar="TEXT", help="title of the page (default: the name of the campaign)"
    )
    parser.add_argument("--author", default="", metavar="NAME", help="author, for the page's head")
    add_allow_code(parser)
    for name, least, default, text in (
        ("stars", 1, 60, "trials whose single stars are measured"),
        ("slews", 1, 60, "trials at each of seven slew rates"),
        ("budget", 2, 60, "trials that the error budget is measured on"),
        ("fidelity-trials", 2, 60, "trials at each fidelity, to compare them"),
        ("worst", 0, 3, "worst trials to show with their frames"),
        ("conditions", 2, 200, "trials in each condition of the verdict, but the design's own"),
    ):
        parser.add_argument(
            f"--{name}", type=whole(least), default=default, metavar="N",
            help=f"{text} (default: {default})",
        )  # fmt: skip
    parser.add_argument(
        "--rungs", dest="fidelity_trials", type=whole(2), help=argparse.SUPPRESS,
    )  # fmt: skip


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
        store.require_code()
    with store, progress("trials repeated", repeated(store, depth)) as advance:
        html = write_report(store, title, depth, advance, options.author)
        trials = len(store.outcomes())
    save_text(path, html)
    size = len(html.encode())
    result = {"report": str(path), "trials": trials, "bytes": size}
    print_result(options, result, f"{path}: {trials} trials, {size / 1e6:.1f} MB")
    return Exit.DONE
