"""`startrack verify`: a verdict on each requirement of a design."""

from __future__ import annotations

import argparse
from pathlib import Path

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
    from startrack.design import Case, Fidelity
    from startrack.io import finite, save_json, save_text
    from startrack.montecarlo import Sampling, pool, warm
    from startrack.optimise import VERIFYING, VERIFYING_UNIT, Ledger, TrialRunner
    from startrack.population import Units
    from startrack.trial import require_fidelity


declare = Options(
    "Judges each requirement of [campaign.requirements], in the design's own condition, at rest, "
    "and in all other conditions that it names: pass, fail, or not shown, with the number of "
    "trials that would do. Errors and availability are shown by trials that no other command "
    "uses, doubled until each is decided; either answer is wrong with a probability of at most "
    "one minus the confidence that is required (default: 5 %). With --out it writes verdict.md, "
    "verdict.json and ledger.sqlite, from which the same command continues. The status is 3 if a "
    "requirement is not met, or not shown.",
    *campaign(),
    Option("--trials N", "trials in each condition at most", whole(2, 10**8), 8192),
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
        "judge N units of the design instead, by the share that meets each "
        "requirement, at the begin and the end of life; fidelity window by default",
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
    warm(case, Sampling(fidelity))  # what no trial can do is refused before the first
    with (
        Ledger(options.out / LEDGER if options.out else None) as ledger,
        pool(options.workers) as executor,
        terminal.progress("trials", total) as advance,
    ):
        runner = TrialRunner(options.seed, executor, options.workers, ledger)

        def trials(case: Case, number: int) -> Rows:
            return runner.run(case, number, fidelity, VERIFYING, advance)

        def of_units(case: Case, how: Units) -> Rows:
            first, number = VERIFYING_UNIT * how.trials, units * how.trials
            return runner.run(case, number, fidelity, first, advance, how)

        if units:
            by_units = verification.verify_units(case, campaign, of_units, units, options.seed)
            answer, values = by_units.answer, verification.unit_values(by_units)
            table = verification.unit_text(by_units)
        else:
            verified = verification.verify(
                case,
                campaign,
                trials,
                options.seed,
                looks,
                lambda name, number: advance(0, f"{name}: {number} trials"),
            )
            answer, values = verified.answer, verification.verdict_values(verified)
            table = f"{verification.verdict_text(verified)}\n{noise_only(case)}"
    unknowns = [unknown.name for unknown in design.unknowns]
    drawn = None if units else draws_of(options, path)
    if unknowns and not (answer is verification.Answer.FAIL and not (drawn and drawn.all_met)):
        answer = verification.Answer.NOT_SHOWN
        values["verdict"] = answer.value
        by_formula = f"; {limits_text(drawn)}" if drawn else ""
        conditions = f" and {many} draws" if (many := campaign.unknown_draws) else ""
        _, _, rest = table.partition("\n")
        table = (
            f"verdict: NOT SHOWN: not known: {', '.join(unknowns)}, "
            f"and what is answered below is so for the middle of their laws{conditions}"
            f"{by_formula}; startrack predict gives the interval\n{rest}"
        )
    result = {"design": str(path), "seed": options.seed, "fidelity": fidelity.value}
    result |= {"unknowns": unknowns} if unknowns else {}
    if drawn:
        result["draws"] = {"number": len(drawn.draws), "met": drawn.count_met()}
        result["draws"] |= {"all_met": drawn.all_met, "without_attitude": drawn.lost}
    result |= values | {"noise_only": not units}
    if options.out:
        save_text(options.out / "verdict.md", f"```\n{table}\n```\n")
        save_json(options.out / "verdict.json", finite(result))
        result["out"] = str(options.out)
    for reason in () if units else values["not_judged"]:
        terminal.print_message(f"not judged: {reason}")
    terminal.print_result(options, result, table)
    return Exit.DONE if answer is verification.Answer.PASS else Exit.UNSOLVED
