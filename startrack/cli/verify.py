"""`startrack verify`: a verdict on each requirement of a design."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

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
    from startrack.core import Rows
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
    case, campaign = design.case, design.asked
    if campaign is None:
        raise shared.WrongUse(f"{path} must have a table [campaign] with requirements")
    judge: _Units | _AsDesigned = _Units(options.units)
    if not options.units:
        with shared.as_wrong_use():
            alpha = 1 - campaign.requirements.confidence
            first = min(options.first, options.trials)
            judge = _AsDesigned(verification.Looks(first, options.trials, alpha))
    fidelity = Fidelity(options.fidelity or judge.fidelity)
    with shared.as_wrong_use(path=path):
        judged, _ = verification.cases(case, campaign)
        for condition in judged:
            require_fidelity(condition.case, fidelity)
        judge.check(case)
    warm(case, Sampling(fidelity))  # impossible trials are refused before the first
    with (
        Ledger(options.out / LEDGER if options.out else None) as ledger,
        pool(options.workers) as executor,
        terminal.progress("trials", judge.trials(case, campaign) * len(judged)) as advance,
    ):
        runner = TrialRunner(options.seed, executor, options.workers, ledger)
        verdict = judge.verdict(case, campaign, fidelity, runner, advance)
    drawn = judge.draws(options, path)
    verdict = _where_unknown(verdict, design, drawn)
    result = {"design": str(path), "seed": options.seed, "fidelity": fidelity.value}
    if design.unknowns:
        result["unknowns"] = [unknown.name for unknown in design.unknowns]
    if drawn:
        result["draws"] = {"number": len(drawn.draws), "met": drawn.count_met()}
        result["draws"] |= {"all_met": drawn.all_met, "without_attitude": drawn.lost}
    result |= verdict.values
    if options.out:
        save_text(options.out / "verdict.md", f"```\n{verdict.table}\n```\n")
        save_json(options.out / "verdict.json", finite(result))
        result["out"] = str(options.out)
    for reason in verdict.not_judged:
        terminal.print_message(f"not judged: {reason}")
    terminal.print_result(options, result, verdict.table)
    return Exit.DONE if verdict.answer is verification.Answer.PASS else Exit.UNSOLVED


class _Verdict(NamedTuple):
    """The answer, its values for JSON, its table as text, and why some limits are not judged."""

    answer: verification.Answer
    values: dict[str, Any]
    table: str
    not_judged: Sequence[str] = ()


@dataclass(frozen=True)
class _AsDesigned:
    """Judges the unit as designed, at numbers of trials that grow."""

    looks: verification.Looks

    fidelity: ClassVar[str] = "frame"

    def check(self, case: Case) -> None:
        """Accept any design."""

    def trials(self, case: Case, campaign: Campaign) -> int:
        """Largest number of trials of a condition."""
        return self.looks.most

    def verdict(
        self,
        case: Case,
        campaign: Campaign,
        fidelity: Fidelity,
        runner: TrialRunner,
        advance: Callable[..., None],
    ) -> _Verdict:
        """The verdict; `advance` as from `terminal.progress`."""

        def trials(case: Case, number: int) -> Rows:
            return runner.run(case, number, fidelity, VERIFYING, advance)

        verified = verification.verify(
            case,
            campaign,
            trials,
            runner.seed,
            self.looks,
            lambda name, number: advance(0, f"{name}: {number} trials"),
        )
        table = f"{verification.verdict_text(verified)}\n{noise_only(case)}"
        values: dict[str, Any] = verification.verdict_values(verified)
        values |= {"noise_only": True}
        return _Verdict(verified.answer, values, table, values["not_judged"])

    def draws(self, options: argparse.Namespace, path: Path) -> DesignedDraws | None:
        """Draws of the unknown values of a design, by formula."""
        return draws_of(options, path)


@dataclass(frozen=True)
class _Units:
    """Judges a number of units, at the begin and the end of life."""

    count: int

    fidelity: ClassVar[str] = "window"

    def check(self, case: Case) -> None:
        """Refuse a design whose units do not differ."""
        require_units(case)

    def trials(self, case: Case, campaign: Campaign) -> int:
        """Number of trials of a condition."""
        ages = len(dict.fromkeys((0.0, case.end_of_life)))
        return self.count * verification.trials_of_a_unit(campaign) * ages

    def verdict(
        self,
        case: Case,
        campaign: Campaign,
        fidelity: Fidelity,
        runner: TrialRunner,
        advance: Callable[..., None],
    ) -> _Verdict:
        """The verdict; `advance` as from `terminal.progress`."""

        def trials(case: Case, how: Units) -> Rows:
            first, number = VERIFYING_UNIT * how.trials, self.count * how.trials
            return runner.run(case, number, fidelity, first, advance, how)

        verified = verification.verify_units(case, campaign, trials, self.count, runner.seed)
        values = verification.unit_values(verified) | {"noise_only": False}
        return _Verdict(verified.answer, values, verification.unit_text(verified))

    def draws(self, options: argparse.Namespace, path: Path) -> DesignedDraws | None:
        """No draws: units are judged for the medians of unknown values."""
        return None


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
    values = verdict.values | {"verdict": not_shown.value}
    return verdict._replace(answer=not_shown, values=values, table=table)
