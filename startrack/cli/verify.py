"""`startrack verify`: a verdict on each requirement of a design."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from startrack.cli import options as shared
from startrack.cli.not_known import DRAWS
from startrack.cli.options import Exit, Option, Options, campaign, fidelity, wanted, whole

if wanted(__name__):
    from startrack import verification
    from startrack.budget import noise_only
    from startrack.cli import terminal
    from startrack.cli.campaign import LEDGER
    from startrack.cli.not_known import draws_of, limits_text
    from startrack.cli.units import require_units
    from startrack.core import Advance, Rows
    from startrack.design import Campaign, Case, Design, Fidelity
    from startrack.io import finite, save_json, save_text
    from startrack.montecarlo import Sampling, pool, warm
    from startrack.optimise import VERIFYING, VERIFYING_UNIT, Ledger, TrialRunner
    from startrack.population import Units
    from startrack.prediction import DesignedDraws
    from startrack.trial import require_fidelity


declare = Options(
    "Judges each requirement of [campaign.requirements] in the design's own condition, at rest, "
    "and in all other conditions of the campaign: pass, fail, or not shown, with the sufficient "
    "number of trials. Errors and availability are tested by trials that no other command uses. "
    "Their number is doubled until each requirement is decided. A pass or a fail is wrong with a "
    "probability of at most one minus the required confidence (default: 5 %). With --out it "
    "writes verdict.md, verdict.json and ledger.sqlite, from which the same command continues. "
    "The status is 3 if a requirement is not met, or not shown.",
    *campaign(),
    Option("--trials N", "largest number of trials in each condition", whole(2, 10**8), 8192),
    Option(
        "--first N",
        "trials in each condition at the first test (default: 256, or --trials if fewer)",
        whole(2, 10**8),
        256,
    ),
    fidelity("frame: render whole frames (default); window, spots, covariance: see montecarlo"),
    shared.SEED,
    shared.WORKERS,
    Option(
        "--units N",
        "judge N units of the design instead, by the fraction that meets each requirement, at "
        "the begin and the end of life; default fidelity: window",
        whole(2, 10**5),
    ),
    DRAWS,
    Option("--out DIR", "folder for results", Path),
    fidelity=None,
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Print the table of verdicts; with --out, write it."""
    path = options.campaign or terminal.example()
    design = terminal.read_design(path, options.set)
    case, campaign, units = design.case, design.asked, options.units
    if campaign is None:
        raise shared.WrongUse(f"{path} must have a table [campaign] with requirements")
    fidelity = Fidelity(options.fidelity or ("window" if units else "frame"))
    with shared.as_wrong_use():
        looks = verification.Looks(
            min(options.first, options.trials), options.trials, 1 - campaign.requirements.confidence
        )
    with shared.as_wrong_use(path=path):
        judged, _ = verification.cases(case, campaign)
        for condition in judged:
            require_fidelity(condition.case, fidelity)
        if units:
            require_units(case)
    total = options.trials * len(judged)
    if units:
        ages = len(dict.fromkeys((0.0, case.end_of_life)))
        total = units * verification.trials_of_a_unit(campaign) * ages * len(judged)
    warm(case, Sampling(fidelity))  # impossible trials are refused before the first
    with (
        Ledger(options.out / LEDGER if options.out else None) as ledger,
        pool(options.workers) as executor,
        terminal.progress("trials", total) as advance,
    ):
        runner = TrialRunner(options.seed, executor, options.workers, ledger)
        if units:
            verdict = _of_units(case, campaign, units, fidelity, runner, advance)
        else:
            verdict = _as_designed(case, campaign, looks, fidelity, runner, advance)
    drawn = None if units else draws_of(options, path)
    verdict = _where_unknown(verdict, design, drawn)
    result = {"design": str(path), "seed": options.seed, "fidelity": fidelity.value}
    if design.unknowns:
        result["unknowns"] = [unknown.name for unknown in design.unknowns]
    if drawn:
        result["draws"] = {"number": len(drawn.draws), "met": drawn.count_met()}
        result["draws"] |= {"all_met": drawn.all_met, "without_attitude": drawn.lost}
    result |= verdict.values | {"noise_only": not units}
    if options.out:
        save_text(options.out / "verdict.md", f"```\n{verdict.table}\n```\n")
        save_json(options.out / "verdict.json", finite(result))
        result["out"] = str(options.out)
    for reason in () if units else verdict.values["not_judged"]:
        terminal.print_message(f"not judged: {reason}")
    terminal.print_result(options, result, verdict.table)
    return Exit.DONE if verdict.answer is verification.Answer.PASS else Exit.UNSOLVED


class _Verdict(NamedTuple):
    """The answer, its values for JSON, and its table as text."""

    answer: verification.Answer
    values: dict[str, Any]
    table: str


def _as_designed(
    case: Case,
    campaign: Campaign,
    looks: verification.Looks,
    fidelity: Fidelity,
    runner: TrialRunner,
    advance: Callable[..., None],
) -> _Verdict:
    """The verdict on the unit as designed; `advance` as from `terminal.progress`."""

    def trials(case: Case, number: int) -> Rows:
        return runner.run(case, number, fidelity, VERIFYING, advance)

    verified = verification.verify(
        case,
        campaign,
        trials,
        runner.seed,
        looks,
        lambda name, number: advance(0, f"{name}: {number} trials"),
    )
    table = f"{verification.verdict_text(verified)}\n{noise_only(case)}"
    return _Verdict(verified.answer, verification.verdict_values(verified), table)


def _of_units(
    case: Case,
    campaign: Campaign,
    units: int,
    fidelity: Fidelity,
    runner: TrialRunner,
    advance: Advance,
) -> _Verdict:
    """The verdict on a number of units, at the begin and the end of life."""

    def trials(case: Case, how: Units) -> Rows:
        first, number = VERIFYING_UNIT * how.trials, units * how.trials
        return runner.run(case, number, fidelity, first, advance, how)

    verified = verification.verify_units(case, campaign, trials, units, runner.seed)
    table = verification.unit_text(verified)
    return _Verdict(verified.answer, verification.unit_values(verified), table)


def _where_unknown(verdict: _Verdict, design: Design, drawn: DesignedDraws | None) -> _Verdict:
    """NOT SHOWN for a design with unknown values; a failure stays unless a draw meets all limits.

    drawn  draws by formula; None: without draws
    """
    unknowns, not_shown = design.unknowns, verification.Answer.NOT_SHOWN
    fails = verdict.answer is verification.Answer.FAIL and not (drawn and drawn.all_met)
    if not unknowns or fails:
        return verdict
    names = ", ".join(unknown.name for unknown in unknowns)
    by_formula = f"; {limits_text(drawn)}" if drawn else ""
    draws = design.campaign.unknown_draws if design.campaign else 0
    conditions = f" and {draws} draws" if draws else ""
    _, _, rest = verdict.table.partition("\n")
    table = (
        f"verdict: NOT SHOWN: unknown: {names}; the answers below are for the medians of their "
        f"laws{conditions}{by_formula}; startrack predict gives the interval\n{rest}"
    )
    return _Verdict(not_shown, verdict.values | {"verdict": not_shown.value}, table)
