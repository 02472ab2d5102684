"""`startrack report`: a campaign as one page to read and to send."""

from __future__ import annotations

import argparse
from pathlib import Path

from startrack.cli.exits import Exit, WrongUse
from startrack.cli.options import describe, whole
from startrack.cli.terminal import progress, tell
from startrack.io import save_text
from startrack.montecarlo import Store, one_thread
from startrack.report import Depth, write_report


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack report`."""
    describe(
        parser,
        "Summary, distributions, sky, error budget, stars, slew rate, fidelities, the worst trials "
        "with their frames, and all inputs. Some trials are done again to look closer; "
        "their numbers say how long that takes.",
    )
    parser.add_argument(
        "campaign", type=Path, metavar="CAMPAIGN.sqlite", help="the store of `montecarlo`"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.html", help="(default: beside the campaign)"
    )
    parser.add_argument("--title", metavar="TEXT", help="(default: the campaign's name)")
    for name, least, default, text in (
        ("stars", 1, 60, "trials whose stars are looked at one by one"),
        ("slews", 1, 60, "trials at each of seven slew rates"),
        ("budget", 2, 60, "skies that the error budget is measured on"),
        ("rungs", 2, 60, "trials done at each fidelity"),
        ("worst", 0, 3, "trials shown with their frames"),
    ):
        parser.add_argument(
            f"--{name}", type=whole(least), default=default, metavar="N",
            help=f"{text} (default: {default})",
        )  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Write the page."""
    one_thread()
    path = options.out or options.campaign.with_suffix(".html")
    title = options.title or f"Campaign {options.campaign}"
    try:
        depth = Depth(
            options.stars, options.slews, options.budget, options.fidelity_comparison, options.worst
        )
        store = Store(options.campaign)
    except ValueError as error:
        raise WrongUse(str(error)) from None
    with store, progress("trials looked at again", depth.trials) as advance:
        html = write_report(store, title, depth, advance)
        trials = len(store.outcomes())
    save_text(path, html)
    size = len(html.encode())
    result = {"report": str(path), "trials": trials, "bytes": size}
    tell(options, result, f"{path}: {trials} trials, {size / 1e6:.1f} MB")
    return Exit.DONE
