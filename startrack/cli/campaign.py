"""What the commands on campaigns share: the design, the runner of its trials, and the folder."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from startrack.cli.options import as_wrong_use
from startrack.cli.scheduler import open_workers
from startrack.cli.terminal import example, print_message, read_campaign
from startrack.core import Refused
from startrack.design import NOMINAL, Campaign, Case, DesignSpace, Fidelity, branches
from startrack.montecarlo import Sampling, warm
from startrack.optimise import Ledger, TrialRunner
from startrack.trial import require_fidelity

LEDGER = "ledger.sqlite"


class OpenCampaign(NamedTuple):
    """A campaign on a design, the runner of its trials, and the folder for results."""

    case: Case
    campaign: Campaign
    runner: TrialRunner
    out: Path


def require_campaign_fidelity(campaign: Campaign, case: Case) -> None:
    """Refuse a campaign whose trials, in any of its conditions, its fidelity cannot compute.

    Raises  ValueError that names the key.
    """
    for one in campaign.judged(case):
        try:
            require_fidelity(one.case, campaign.fidelity)
        except Refused as error:
            where = "" if one.name == NOMINAL else f" in the condition {one.name}"
            raise ValueError(f"campaign.fidelity{where}: {error}") from None


@contextmanager
def open_campaign(options: argparse.Namespace, doing: str) -> Iterator[OpenCampaign]:
    """Read the campaign, check its variables, open workers and the ledger of the folder.

    Kernels are compiled before the workers start, so that each reads them from the cache. The
    ledger holds the results of an interrupted run, from which the same command continues.
    """
    path, workers = options.campaign or example(), open_workers(options)
    design, campaign = read_campaign(path, options.set)
    with as_wrong_use(path=path):
        for branch in branches(design.case, campaign.choices):
            DesignSpace(branch.case, campaign.variables, campaign.links)
            require_campaign_fidelity(campaign, branch.case)
    print_message(
        f"{doing} {path.stem} with {options.workers} workers"
        + (f" of {options.scheduler}" if options.scheduler else "")
        + f"; results go to {options.out}"
    )
    if options.workers > 1 and not options.scheduler:
        for fidelity in dict.fromkeys((campaign.fidelity, Fidelity.FRAME)):
            with suppress(Refused):  # a start that cannot be rendered is judged by the search
                warm(design.case, Sampling(fidelity))
    with (
        Ledger(options.out / LEDGER) as ledger,
        workers as executor,
    ):
        runner = TrialRunner(options.seed, executor, options.workers, ledger)
        yield OpenCampaign(design.case, campaign, runner, options.out)
