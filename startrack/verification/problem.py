"""Problem -> a verdict on each of its limits, by formula and by trials."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from startrack.core import Refused, Rows
from startrack.metrics import Column, Interval, Table, end_text
from startrack.problem import Judgement, Margin, Problem
from startrack.verification.decide import MOST, Answer, Looks, decide
from startrack.verification.verify import FORMULA, Verdict, Verification, answer_text

TRIALS = "trials"


@dataclass(frozen=True)
class LimitClaim:
    """Claim that a value, decided by trials, meets its limit."""

    name: str
    margin: Margin

    def answer(self, bounds: Interval) -> Answer:
        """Decision by the lower bound, which decides a fail, and the upper, which decides a
        pass."""
        if self.margin._replace(value=bounds.high).relative >= 0:
            return Answer.PASS
        fails = self.margin._replace(value=bounds.low).relative < 0
        return Answer.FAIL if fails else Answer.NOT_SHOWN

    def needed(self, bounds: Interval, number: int) -> int | None:
        """Number of trials that would decide it, if further trials are like these; None: no number.

        The width of bounds is inversely proportional to the root of the number.
        """
        gap = self.margin.limit - bounds.value
        met = self.margin._replace(value=bounds.value).relative >= 0
        width = (bounds.high if met else bounds.low) - bounds.value
        if not gap or not math.isfinite(width):
            return None
        enough = number * (width / gap) ** 2
        return math.ceil(enough) if enough < MOST else None


def verify_problem(
    problem: Problem,
    rows: Callable[[int], Rows],
    looks: Looks,
    watch: Callable[[int], None] | None = None,
) -> Verification:
    """Judge each limit of a problem: costs by their formulas, the others by trials.

    Trials are judged at the numbers of `looks` until all limits are decided. See `Looks` for the
    probability of a wrong answer; it is as exact as the problem's intervals.

    rows    number of trials -> their rows, which must not have tuned the design
    watch   called with each number of trials before these are run
    Raises  Refused if a trial cannot be run.
    """
    verdicts = [_by_formula(name, margin) for name, margin in problem.costs().items()]
    verdicts += _by_trials(problem, rows, looks, watch)
    return Verification(tuple(verdicts), looks, ())


def _by_formula(name: str, margin: Margin) -> Verdict:
    part = margin.relative
    answer = Answer.PASS if part >= 0 else Answer.FAIL
    value, unit = margin.value, margin.unit
    return Verdict(
        condition="",
        name=name,
        statistic=FORMULA,
        limit=margin.limit,
        analysis=value,
        trials=None,
        number=0,
        margin=part,
        answer=answer,
        unit=unit,
    )


def _by_trials(
    problem: Problem, rows: Callable[[int], Rows], looks: Looks, watch: Callable[[int], None] | None
) -> Iterator[Verdict]:
    expected, note = _expected(problem)
    # Two trials are enough to know the names of the limits.
    limits = {name: margins[0] for name, margins in problem.judge(rows(2)).margins.items()}
    claims = [LimitClaim(name, margin) for name, margin in limits.items()]
    if not claims:
        return
    passing, failing = looks.tails(len(claims))

    def evidence(size: int) -> tuple[Judgement, Judgement]:
        if watch:
            watch(size)
        tried = rows(size)
        return problem.judge(tried, 1 - 2 * passing), problem.judge(tried, 1 - 2 * failing)

    def bounds(claim: LimitClaim, shown: tuple[Judgement, Judgement]) -> Interval:
        to_pass, to_fail = (judged.margins[claim.name] for judged in shown)
        return Interval(to_pass[0].value, to_fail[2].value, to_pass[1].value)

    decided, _ = decide(looks, claims, evidence, bounds)
    for claim in claims:
        found, number = decided[claim.name]
        answer = claim.answer(found)
        yield Verdict(
            condition="",
            name=claim.name,
            statistic=TRIALS,
            limit=claim.margin.limit,
            analysis=expected[claim.name].value if claim.name in expected else math.nan,
            trials=found,
            number=number,
            margin=claim.margin._replace(value=found.value).relative,
            answer=answer,
            needed=claim.needed(found, number) if answer is Answer.NOT_SHOWN else None,
            note=note,
            unit=claim.margin.unit,
        )


def _expected(problem: Problem) -> tuple[Mapping[str, Margin], str]:
    """Margins by formula, or why there are none."""
    try:
        return problem.expect().margins, ""
    except Refused as reason:
        return {}, f"no forecast: {reason}"


def problem_verdict_table(verified: Verification) -> Table:
    """A record for each verdict on a problem; values in SI."""

    def bounds(verdict: Verdict) -> str:
        tried = verdict.trials
        if tried is None:
            return ""
        return f"[{end_text(tried.low, '.4g')}, {end_text(tried.high, '.4g')}]"

    columns = [
        Column("requirement", "requirement", lambda row: row.name),
        Column("unit", "unit", lambda row: row.unit),
        Column("limit", "limit", lambda row: row.limit, form=".4g"),
        Column("analysis", "by formula", lambda row: row.analysis, form=".4g"),
        Column("trials", "", lambda row: row.trials.value if row.trials else None),
        Column("bounds", "", lambda row: [row.trials.low, row.trials.high] if row.trials else None),
        Column("", "by trials", lambda row: f"{row.trials.value:.4g}" if row.trials else ""),
        Column("", "bounds", bounds),
        Column("number", "", lambda row: row.number),
        Column("", "n", lambda row: str(row.number) if row.trials else ""),
        Column("margin", "margin", lambda row: row.margin, form="+.3f"),
        Column("verdict", "", lambda row: row.answer.value),
        Column("", "verdict", answer_text),
        Column("trials_needed", "", lambda row: row.needed),
        Column("note", "", lambda row: row.note),
    ]
    return Table(columns, verified.verdicts)
