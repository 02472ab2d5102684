"""`startrack report`: a campaign as one page to read and to send."""

from __future__ import annotations

import argparse

from startrack.campaign.store import Store
from startrack.commands.terminal import progress, tell
from startrack.exits import Exit, WrongUse
from startrack.report import write_report
from startrack.report.write import Depth
from startrack.saving import save_text
from startrack.study.workers import one_thread


def command(options: argparse.Namespace) -> int:
    """Write the page."""
    one_thread()
    path = options.out or options.campaign.with_suffix(".html")
    title = options.title or f"Campaign {options.campaign}"
    try:
        depth = Depth(options.stars, options.slews, options.budget, options.rungs, options.worst)
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
