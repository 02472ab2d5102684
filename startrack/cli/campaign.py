"""Shared parts of commands on campaigns: the design, the runner of its trials, and the folder."""

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from startrack.cli import terminal
from startrack.cli.options import WrongUse, as_wrong_use
from startrack.core import Refused
from startrack.design import NOMINAL, Campaign, Case, Design, DesignSpace, Fidelity, branches
from startrack.io import finite, regular_file, save_json, save_text
from startrack.montecarlo import Certificates, Sampling, cluster, pool, warm
from startrack.optimise import Ledger, SearchStage, TrialRunner, unmet_costs
from startrack.trial import require_fidelity
from startrack.verification import limited

LEDGER = "ledger.sqlite"


def open_workers(options: argparse.Namespace) -> AbstractContextManager[Executor]:
    """The executor of --workers or --scheduler; the caller opens it."""
    encrypted = (options.scheduler or "").startswith("tls://")
    if encrypted != bool(options.tls):
        raise WrongUse("--tls must be given with --scheduler tls://host:port alone")
    if not options.scheduler:
        return pool(options.workers)
    with as_wrong_use(ValueError, OSError):
        files = [regular_file(path, "a file in PEM") for path in options.tls or ()]
    return cluster(options.scheduler, Certificates(*files) if files else None)


def require_campaign_fidelity(campaign: Campaign, case: Case) -> None:
    """Refuse a campaign whose fidelity cannot compute trials in one of its conditions.

    Raises  ValueError that names the key.
    """
    for condition in campaign.judged(case):
        try:
            require_fidelity(condition.case, campaign.fidelity)
        except Refused as error:
            where = "" if condition.name == NOMINAL else f" in the condition {condition.name}"
            raise ValueError(f"campaign.fidelity{where}: {error}") from None


class ReadCampaign(NamedTuple):
    """A checked campaign.

    spaces  spaces of its choices, or the space of its variables
    """

    path: Path
    design: Design
    campaign: Campaign
    spaces: Sequence[DesignSpace]


def read_study(options: argparse.Namespace) -> ReadCampaign:
    """Read the campaign of a command and check its variables, choices and fidelity."""
    path = options.campaign or terminal.example()
    design, campaign = terminal.read_campaign(path, options.set)
    spaces = list[DesignSpace]()
    with as_wrong_use(path=path):
        for branch in branches(design.case, campaign.choices):
            spaces.append(DesignSpace(branch.case, campaign.variables, campaign.links))
            require_campaign_fidelity(campaign, branch.case)
    return ReadCampaign(path, design, campaign, spaces)


def unmet_text(study: ReadCampaign) -> str:
    """Message on cost limits that every design of a study exceeds; empty if all limits can be
    met."""
    needs = study.campaign.requirements
    nearest = [
        "{} {} at best, limit {}".format(name, *limited(needs, name, margin))
        for name, margin in unmet_costs(study.spaces, needs).items()
    ]
    short = "; ".join(nearest)
    return f"no design of the space meets the limits of costs: {short}" if short else ""


@contextmanager
def open_runner(
    options: argparse.Namespace, study: ReadCampaign, doing: str
) -> Iterator[TrialRunner]:
    """Open workers and the ledger of the folder. Yields the runner of the study's trials.

    Workers import the package while this process compiles the kernels; then each worker reads the
    kernels from the cache. The ledger has the results of an interrupted run, so that the same
    command continues it.
    """
    workers = open_workers(options)
    terminal.print_message(
        f"{doing} {study.path.stem} with {options.workers} workers"
        + (f" of {options.scheduler}" if options.scheduler else "")
        + f"; results go to {options.out}"
    )
    with workers as executor:
        if not options.scheduler and options.workers > 1:
            for _ in range(options.workers):
                executor.submit(_imported)
        # Designs without possible trials are refused before a ledger is made.
        for fidelity in dict.fromkeys((study.campaign.fidelity, Fidelity.FRAME)):
            with suppress(Refused):  # the search judges a start that cannot be rendered
                warm(study.design.case, Sampling(fidelity))
        with Ledger(options.out / LEDGER) as ledger:
            yield TrialRunner(options.seed, executor, options.workers, ledger)


@contextmanager
def stages(title: str) -> Iterator[Callable[[SearchStage], None]]:
    """A progress bar of the stages of a search. Yields the function that shows a stage."""
    with terminal.progress(title, 100) as advance:
        done = 0.0

        def show(stage: SearchStage) -> None:
            nonlocal done
            step, done = max(100 * stage.part - done, 0.0), max(100 * stage.part, done)
            best = f", best {stage.best:.3g} {stage.unit}" if math.isfinite(stage.best) else ""
            advance(step, stage.name + best)

        yield show


def _imported() -> None:
    """Do nothing. Workers call it to import this file."""


def write_study(
    options: argparse.Namespace, name: str, table: str, result: dict[str, Any], ending: str = ""
) -> None:
    """Write the table of a study as Markdown, its result as JSON, and print both."""
    save_text(options.out / f"{name}.md", table + "\n")
    save_json(options.out / "result.json", finite(result))
    terminal.print_result(options, result, f"{table}\n\n{ending}results are in {options.out}")
