"""Design, campaign -> a verdict on each requirement, by analysis and by trials, and their table."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from startrack.budget import analytic
from startrack.core import Floats, Refused, Rows, arcsec
from startrack.design import Campaign, Case, Judged, Requirements
from startrack.metrics import Column, Interval, Summary, Table
from startrack.verification.accuracy import (
    expected_availability,
    expected_over,
    limited,
    margins,
    needed_magnitude,
)
from startrack.verification.cases import boresights, cases, counted
from startrack.verification.decide import Answer, Claim, Looks, answer_of, claims_of, decide
from startrack.verification.decide import tails as tails_of_looks

SHOWN = 0.95  # confidence level of intervals in a summary
Trials = Callable[[Case, int], Rows]
FORMULA = "formula"


@dataclass(frozen=True)
class Verdict:
    """One requirement in one condition.

    condition  name of the condition
    name       name of the requirement
    statistic  the limited statistic, in words
    limit      radian, or a fraction; NaN for a requirement by formula
    analysis   value of the statistic by the analytic budget; NaN without a budget
    trials     value by trials, with the bounds that decide a fail and a pass; None if the
               requirement needs no trials
    number     number of trials
    margin     margin as a fraction of the limit (stars: magnitude; availability: difference), by
               trials if there are any
    answer     pass, fail or not shown
    needed     number of trials that would decide it if it is not shown; None: unknown
    note       why there is no value; empty if there is one
    unit       unit of limit and values, as a text; none: radian or a fraction
    shown      value and limit by formula with their units, of a requirement that needs no trials
    """

    condition: str
    name: str
    statistic: str
    limit: float
    analysis: float
    trials: Interval | None
    number: int
    margin: float
    answer: Answer
    needed: int | None = None
    note: str = ""
    unit: str = ""
    shown: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class Verification:
    """All verdicts on a design.

    verdicts  verdicts, in the order of the conditions
    looks     numbers of trials at which they were tested, and the error probabilities of the tests
    left      conditions that could not be judged, and why
    """

    verdicts: tuple[Verdict, ...]
    looks: Looks
    left: tuple[str, ...]

    @property
    def answer(self) -> Answer:
        """Fail if one fails, pass if all pass."""
        return answer_of([verdict.answer for verdict in self.verdicts], self.left)


def verify(
    case: Case,
    campaign: Campaign,
    trials: Trials,
    seed: int,
    looks: Looks | None = None,
    watch: Callable[[str, int], None] | None = None,
) -> Verification:
    """Judge each requirement of a campaign on a design, in each condition.

    Requirements on mass, power and the like are judged by formulas. Error and availability are
    judged by trials, at the numbers of `looks`, until all requirements of a condition are decided.
    See `Looks` for the probability of a wrong answer, and `Claim.bounds` for its accuracy.

    trials      function that gives outcomes of trials of a case; these trials must not have been
                used to tune the design
    seed        seed of these trials
    watch       called with each condition and its number of trials before these are run
    Raises      ValueError if a condition does not fit the case, or if a trial cannot be run.
    """
    looks = looks or Looks(alpha=1 - campaign.requirements.confidence)
    judged, left = cases(case, campaign)
    verdicts = list(_by_formula(judged[0]))
    tails = looks.tails(number_of_claims(judged))
    for condition in judged:
        verdicts += _by_trials(condition, trials, seed, looks, tails, watch)
    return Verification(tuple(verdicts), looks, left)


def _by_formula(condition: Judged) -> Iterator[Verdict]:
    needs, case = condition.needs, condition.case
    needed = needed_magnitude(case, needs.min_stars, needs.sky_fraction)
    for name, margin in margins(needs, case).items():
        answer = Answer.PASS if margin >= 0 else Answer.FAIL
        shown = limited(needs, name, margin, needed)
        nothing = math.nan, math.nan, None, 0
        yield Verdict(condition.name, name, FORMULA, *nothing, margin, answer, shown=shown)


def _by_trials(
    condition: Judged,
    trials: Trials,
    seed: int,
    looks: Looks,
    tails: tuple[float, float],
    watch: Callable[[str, int], None] | None,
) -> Iterator[Verdict]:
    claims = claims_of(condition.needs)
    analysis, note = _analysis(condition)

    def evidence(size: int) -> tuple[Rows, Floats]:
        if watch:
            watch(condition.name, size)
        outcomes = counted(condition.needs, condition.case, seed, trials(condition.case, size))
        return outcomes, boresights(seed, outcomes)

    def bounds_of(claim: Claim, shown: tuple[Rows, Floats]) -> Interval:
        return claim.bounds(*shown, *tails)

    decided, (outcomes, boresight) = decide(looks, claims, evidence, bounds_of)
    for claim in claims:
        bounds, size = decided[claim.name]
        answer = claim.answer(bounds)
        open_ = answer is Answer.NOT_SHOWN
        yield Verdict(
            condition=condition.name,
            name=claim.name,
            statistic=_statistic(claim),
            limit=claim.limit,
            analysis=analysis.get(claim.name, math.nan),
            trials=bounds,
            number=size,
            margin=claim.margin(bounds.value),
            answer=answer,
            needed=claim.needed(outcomes, boresight, *tails) if open_ else None,
            note=note,
        )


def number_of_claims(judged: Iterable[Judged]) -> int:
    """Number of requirements in all conditions that trials decide together."""
    return sum(len(claims_of(condition.needs)) for condition in judged)


def bounds_of_errors(
    needs: Requirements, outcomes: Rows, boresight: Floats, claims: int = 1
) -> list[tuple[Claim, Interval]]:
    """Limited errors, with the bounds by which one look at trials judges them.

    boresight  (n, 3) unit vectors of the boresight of each outcome, ICRS axes
    claims     number of claims that are judged together
    """
    tails = tails_of_looks(1, 1 - needs.confidence, claims)
    limits = [claim for claim in claims_of(needs) if claim.accuracy]
    return [(claim, claim.bounds(outcomes, boresight, *tails)) for claim in limits]


def with_bounds(
    summary: Summary, needs: Requirements, bounds: Iterable[tuple[Claim, Interval]]
) -> Summary:
    """A summary whose rms errors have the intervals by which requirements are judged.

    An error then has the same 95 % interval in the summary and in its requirement. The intervals
    also hold for skewed distributions of the squared errors.
    """
    known: dict[str, Any] = {
        claim.accuracy.name: interval
        for claim, interval in bounds
        if claim.accuracy
        and claim.accuracy.objective.rms_per_axis
        and claim.sky == "whole"
        and needs.confidence == SHOWN
        and math.isfinite(interval.high)
    }
    return replace(summary, **known)


def _statistic(claim: Claim) -> str:
    if claim.accuracy is None:
        return "fraction of correct attitudes"
    where = ", worst of 12 regions of the sky" if claim.sky == "worst" else ""
    return f"{claim.accuracy.objective}{where}"


def _analysis(condition: Judged) -> tuple[dict[str, float], str]:
    """Values by the analytic budget, or why there are none."""
    try:
        budget = analytic(condition.case)
    except Refused as error:
        return {}, f"no analytic budget: {error}"
    errors = {
        accuracy.name: expected_over(accuracy.objective, budget.whole.spread, condition.needs.sky)
        for accuracy in condition.needs.accuracy
    }
    return {**errors, "availability": expected_availability(condition.needs, budget)}, ""


def verdict_table(verified: Verification) -> Table:
    """A record for each verdict; errors in arcsecond, availability in percent or a fraction."""

    def in_json(verdict: Verdict, value: float) -> float:
        return value / (1.0 if verdict.name == "availability" else arcsec)

    def in_text(verdict: Verdict, value: float) -> str:
        scaled = value / (0.01 if verdict.name == "availability" else arcsec)
        if math.isnan(scaled):
            return "none"
        return "open" if math.isinf(scaled) else f"{scaled:.4g}"

    def limit_text(verdict: Verdict) -> str:
        unit = "%" if verdict.name == "availability" else "arcsec"
        return f"{in_text(verdict, verdict.limit)} {unit}"

    def if_tried(
        write: Callable[[Verdict, Interval], Any], without: Any
    ) -> Callable[[Verdict], Any]:
        return lambda row: without if row.trials is None else write(row, row.trials)

    columns = [
        Column("condition", "condition", lambda row: row.condition),
        Column("requirement", "requirement", lambda row: row.name),
        Column("statistic", "", lambda row: row.statistic),
        Column("limit", "", lambda row: in_json(row, row.limit)),
        Column("analysis", "", lambda row: in_json(row, row.analysis)),
        Column("trials", "", if_tried(lambda row, x: in_json(row, x.value), None)),
        Column(
            "bounds", "", if_tried(lambda row, x: [in_json(row, x.low), in_json(row, x.high)], None)
        ),
        Column("number", "", lambda row: row.number),
        Column("margin", "", lambda row: row.margin),
        Column("verdict", "", lambda row: row.answer.value),
        Column("trials_needed", "", lambda row: row.needed),
        Column("note", "", lambda row: row.note),
        Column("shown", "", lambda row: list(row.shown)),
        Column("", "limit", lambda row: limit_text(row) if row.trials else row.shown[1]),
        Column(
            "", "formula", lambda row: in_text(row, row.analysis) if row.trials else row.shown[0]
        ),
        Column("", "trials", if_tried(lambda row, x: in_text(row, x.value), "")),
        Column(
            "",
            "bounds",
            if_tried(lambda row, x: f"[{in_text(row, x.low)}, {in_text(row, x.high)}]", ""),
        ),
        Column("", "n", if_tried(lambda row, _: str(row.number), "")),
        Column("", "margin", lambda row: f"{row.margin:+.3f}"),
        Column("", "verdict", answer_text),
    ]
    return Table(columns, verified.verdicts)


def verdict_notes(verified: Verification) -> list[str]:
    """Notes on the meaning of the table, and the effects that it leaves out."""
    rows = verified.verdicts
    lines = list(dict.fromkeys(f"{row.name}: {row.statistic}" for row in rows if row.trials))
    lines += [f"{row.condition}: {row.note}" for row in rows if row.note]
    lines += [f"not judged: {reason}" for reason in verified.left]
    lines.append(
        f"{verified.looks.words}. Errors in arcsec, availability in %; margins are fractions of "
        "the limits, the margin of stars is in mag."
    )
    return lines


def verdict_text(verified: Verification) -> str:
    """The verdict, the table and its notes as plain text."""
    lines = verdict_table(verified).text((0, 1, 8))
    open_ = [verdict for verdict in verified.verdicts if verdict.answer is not Answer.PASS]
    names = [
        f"{verdict.name} ({verdict.condition}) {verdict.answer.in_capitals}" for verdict in open_
    ]
    why = f": {', '.join(names)}" if names else ""
    first = f"verdict: {verified.answer.in_capitals}{why}"
    return "\n".join([first, "", *lines, "", *verdict_notes(verified)])


def verdict_values(verified: Verification) -> dict[str, Any]:
    """A verification for JSON; errors in arcsecond, availability as a fraction."""
    return verification_values(verified, verdict_table(verified))


def verification_values(verified: Verification, table: Table) -> dict[str, Any]:
    """A verification for JSON, with the table of its verdicts."""
    return {
        "verdict": verified.answer.value,
        "requirements": table.json(),
        "not_judged": list(verified.left),
        "looks": verified.looks.sizes,
        "wrong_verdict_probability": verified.looks.alpha,
    }


def answer_text(verdict: Verdict) -> str:
    """The answer as a word; if it is not shown, also the number of trials that would decide it."""
    if verdict.trials is None or verdict.answer is not Answer.NOT_SHOWN:
        return verdict.answer.in_capitals
    if not verdict.needed:
        return f"{verdict.answer.in_capitals}: these trials do not tell how many would do"
    return f"{verdict.answer.in_capitals}: about {verdict.needed} trials would do"
