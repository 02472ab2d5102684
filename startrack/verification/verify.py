"""Design, campaign -> a verdict on each requirement, by analysis and by trials."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.budget import analytic
from startrack.core import Refused
from startrack.design import Campaign, Case, Judged
from startrack.metrics import Interval
from startrack.verification.accuracy import expected_availability, expected_over
from startrack.verification.blinded import boresights, counted
from startrack.verification.cases import cases
from startrack.verification.decide import Answer, Claim, Looks, claims_of
from startrack.verification.margins import margins

Trials = Callable[[Case, int], NDArray[np.void]]
FORMULA = "formula"


@dataclass(frozen=True)
class Verdict:
    """One requirement in one condition.

    condition  its name
    name       of the requirement
    statistic  what is limited, in words
    limit      radian, or a fraction; NaN for a requirement by formula, which has a margin only
    analysis   its value by the analytic budget; NaN where there is none
    trials     its value by trials, with the bound that can fail it and the one that can pass it;
               None where it needs no trials
    number     of trials
    margin     as a fraction of the limit (stars: magnitude; availability: as it is), by trials
               where there are any
    answer     pass, fail or not shown
    needed     number of trials that would do where it is not shown; None where none would
    note       why there is no value, or empty
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


@dataclass(frozen=True)
class Verification:
    """All verdicts on a design.

    verdicts  in order of the conditions
    looks     numbers of trials at which they were tested, and the errors of the tests
    left      conditions that could not be judged, and why
    """

    verdicts: tuple[Verdict, ...]
    looks: Looks
    left: tuple[str, ...]

    @property
    def answer(self) -> Answer:
        """Fail where one fails, pass where all pass."""
        answers = [one.answer for one in self.verdicts]
        if Answer.FAIL in answers:
            return Answer.FAIL
        shown = not self.left and all(one is Answer.PASS for one in answers)
        return Answer.PASS if shown else Answer.NOT_SHOWN


def verify(
    case: Case,
    campaign: Campaign,
    trials: Trials,
    seed: int,
    looks: Looks | None = None,
    watch: Callable[[str, int], None] | None = None,
) -> Verification:
    """Judge each requirement of a campaign on a design, in each condition.

    Those on mass, power and the like by their formulas. Error and availability by trials, at the
    numbers of `looks`, until all of a condition are decided: see `Looks` for the probability that
    an answer is wrong, and `Claim.bounds` for how exactly it holds.

    trials      gives the outcomes of so many trials of a case, which must not have tuned the design
    seed        of these trials
    watch       called with each condition and its number of trials before these are run
    Raises      ValueError where a condition does not fit the case, or a trial cannot be run.
    """
    looks = looks or Looks(alpha=1 - campaign.requirements.confidence)
    judged, left = cases(case, campaign)
    verdicts = list(_by_formula(judged[0]))
    count = sum(len(claims_of(one.needs)) for one in judged)
    tails = looks.tails(count)
    for one in judged:
        verdicts += _by_trials(one, trials, seed, looks, tails, watch)
    return Verification(tuple(verdicts), looks, left)


def _by_formula(one: Judged) -> Iterator[Verdict]:
    for name, margin in margins(one.needs, one.case).items():
        answer = Answer.PASS if margin >= 0 else Answer.FAIL
        yield Verdict(one.name, name, FORMULA, math.nan, math.nan, None, 0, margin, answer)


def _by_trials(
    one: Judged,
    trials: Trials,
    seed: int,
    looks: Looks,
    tails: tuple[float, float],
    watch: Callable[[str, int], None] | None,
) -> Iterator[Verdict]:
    claims = claims_of(one.needs)
    analysis, note = _analysis(one)
    decided = dict[str, tuple[Interval, int]]()
    for size in looks.sizes:
        if watch:
            watch(one.name, size)
        outcomes = counted(one.needs, one.case, seed, trials(one.case, size))
        boresight = boresights(seed, outcomes)
        for claim in claims:
            if claim.name in decided:
                continue
            bounds = claim.bounds(outcomes, boresight, *tails)
            if claim.answer(bounds) is not Answer.NOT_SHOWN or size == looks.sizes[-1]:
                decided[claim.name] = bounds, size
        if len(decided) == len(claims):
            break
    for claim in claims:
        bounds, size = decided[claim.name]
        answer = claim.answer(bounds)
        needed = None
        if answer is Answer.NOT_SHOWN:
            needed = claim.needed(outcomes, boresight, *tails)
        yield Verdict(
            one.name,
            claim.name,
            _statistic(claim),
            claim.limit,
            analysis.get(claim.name, math.nan),
            bounds,
            size,
            claim.margin(bounds.value),
            answer,
            needed,
            note,
        )


def _statistic(claim: Claim) -> str:
    if claim.accuracy is None:
        return "fraction of correct attitudes"
    where = ", worst of 12 regions of the sky" if claim.sky == "worst" else ""
    return f"{claim.accuracy.objective}{where}"


def _analysis(one: Judged) -> tuple[dict[str, float], str]:
    """Values by the analytic budget, or why there are none."""
    try:
        budget = analytic(one.case)
    except Refused as error:
        return {}, f"no analytic budget: {error}"
    errors = {
        each.name: expected_over(each.objective, budget, one.needs.sky)
        for each in one.needs.accuracy
    }
    return {**errors, "availability": expected_availability(one.needs, budget)}, ""
