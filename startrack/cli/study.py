"""What the commands on campaigns share: the design that is asked, its bench, and its folder."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from startrack.cli.exits import WrongUse
from startrack.cli.terminal import example, read_campaign, say
from startrack.design import Campaign, Case, DesignSpace, Fidelity, branches
from startrack.montecarlo import Sampling, pool, warm
from startrack.optimise import Ledger, TrialRunner

LEDGER = "ledger.sqlite"


class Study(NamedTuple):
    """A campaign on a design, and where its trials are done and kept."""

    case: Case
    campaign: Campaign
    bench: TrialRunner
    out: Path


@contextmanager
def open_study(options: argparse.Namespace, doing: str) -> Iterator[Study]:
    """Read the campaign, check its box, open workers and the ledger of the folder.

    Compiled kernels are on disk before the workers begin, so that each finds them there.
    What a study that was cut short has done is in the ledger: the same command goes on there.
    """
    path = options.campaign or example()
    design, campaign = read_campaign(path)
    try:
        for branch in branches(design.case, campaign.choices):
            DesignSpace(branch.case, campaign.variables, campaign.links)
    except ValueError as error:
        raise WrongUse(f"{path}: {error}") from None
    say(f"{doing} {path.stem} on {options.workers} workers; results go to {options.out}")
    if options.workers > 1:
        for fidelity in dict.fromkeys((campaign.fidelity, Fidelity.FRAME)):
            warm(design.case, Sampling(fidelity))
    with (
        Ledger(options.out / LEDGER) as ledger,
        pool(options.workers) as executor,
    ):
        bench = TrialRunner(options.seed, executor, options.workers, ledger)
        yield Study(design.case, campaign, bench, options.out)
