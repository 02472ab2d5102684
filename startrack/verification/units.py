"""Design, campaign, units -> a verdict on each requirement by its yield, at both ends of life."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import arcsec
from startrack.design import YEAR, Campaign, Case, Judged
from startrack.io import aligned
from startrack.metrics import Interval, correct
from startrack.population import Units, unit_errors
from startrack.verification.blinded import counted
from startrack.verification.cases import cases
from startrack.verification.decide import Answer, YieldClaim

UnitTrials = Callable[[Case, Units], NDArray[np.void]]
USUAL = 0.95  # of the units, where a campaign does not say how many must be good
ENVIRONMENTS = 4  # of each unit; chosen by hand: time against the rms of a unit


@dataclass(frozen=True)
class YieldVerdict:
    """The yield of a requirement in one condition at one age.

    age     second
    share   of the units that meet it, with the bound that can fail it, and the one that can pass it
    answer  pass, fail or not shown
    needed  number of units that would do where it is not shown; None where none would
    """

    age: float
    share: Interval
    answer: Answer
    needed: int | None


@dataclass(frozen=True)
class UnitRow:
    """A requirement in one condition, by its yields.

    condition  its name
    name       of the requirement
    statistic  of each unit that is limited, in words
    limit      radian, or a fraction
    least      1, of the units, that must meet it
    ages       at the begin and at the end of life
    """

    condition: str
    name: str
    statistic: str
    limit: float
    least: float
    ages: tuple[YieldVerdict, ...]


@dataclass(frozen=True)
class UnitVerification:
    """All verdicts by yields.

    rows    in order of the conditions
    count   units
    trials  of each
    alpha   probability that any pass is wrong, and that any fail is
    left    conditions that could not be judged, and why
    """

    rows: tuple[UnitRow, ...]
    count: int
    trials: int
    alpha: float
    left: tuple[str, ...]

    def at(self, number: int) -> Answer:
        """Of all requirements at one of the ages: fail where one fails, pass where all pass."""
        answers = [one.ages[number].answer for one in self.rows]
        if Answer.FAIL in answers:
            return Answer.FAIL
        shown = not self.left and all(one is Answer.PASS for one in answers)
        return Answer.PASS if shown else Answer.NOT_SHOWN

    @property
    def answer(self) -> Answer:
        """At the last age, the end of life."""
        return self.at(-1)


def verify_units(
    case: Case, campaign: Campaign, trials: UnitTrials, count: int, seed: int
) -> UnitVerification:
    """Judge each error that is limited, and the availability, by the units of a design.

    A unit meets a limit where its own trials do; it meets the availability where so large a
    fraction of its trials has a correct attitude. The yield must be at least `units` of the
    campaign, or 95 %. Each of the two ages is tested once, with the probabilities of a wrong answer
    that `Looks` has for one look.

    trials    gives the outcomes of the trials of units of a case, which must not have tuned it
    count     units
    seed      of these trials
    Raises    ValueError where the units of the design are all alike, or a trial cannot be run.
    Accuracy  of a unit, that of its trials: the scatter of an rms from n of them smears the limit
              by 1 / sqrt(4 n) of it across, and an availability has steps of 1 / n.
    """
    units = replace(campaign, units=campaign.units or USUAL)
    judged, left = cases(case, units)
    over = units.over_units(case)
    assert over is not None
    each, alpha = units.trials_per_unit, 1 - campaign.requirements.confidence
    ages = tuple(dict.fromkeys((0.0, case.end_of_life)))
    claims = sum(len(one.needs.accuracy) + 1 for one in judged)
    tails = alpha, alpha / max(claims, 1)
    rows = list[UnitRow]()
    for one in judged:
        found = list[dict[str, YieldVerdict]]()
        for age in ages:
            how = Units(each, min(ENVIRONMENTS, each), age)
            outcomes = counted(one.needs, one.case, seed, trials(one.case, how))
            found.append(dict(_at(one, outcomes, how, over.fraction, tails)))
        rows += _rows(one, found, over.fraction)
    return UnitVerification(tuple(rows), count, each, alpha, left)


def _at(
    one: Judged,
    outcomes: NDArray[np.void],
    how: Units,
    least: float,
    tails: tuple[float, float],
) -> Iterator[tuple[str, YieldVerdict]]:
    unit, claim = outcomes["trial"] // how.trials, YieldClaim(least)
    met = {
        each.name: unit_errors(each.objective, outcomes, unit) <= each.most
        for each in one.needs.accuracy
    }
    _, place = np.unique(unit, return_inverse=True)
    good = np.bincount(place, correct(outcomes, one.needs.limits)) / np.bincount(place)
    met["availability"] = good >= one.needs.min_availability
    for name, each in met.items():
        yield name, _verdict(claim, each, how.age, tails)


def _verdict(
    claim: YieldClaim, met: NDArray[np.bool_], age: float, tails: tuple[float, float]
) -> YieldVerdict:
    bounds = claim.bounds(met, *tails)
    answer = claim.answer(bounds)
    needed = claim.needed(bounds.value, *tails) if answer is Answer.NOT_SHOWN else None
    return YieldVerdict(age, bounds, answer, needed)


def _rows(one: Judged, found: list[dict[str, YieldVerdict]], least: float) -> Iterator[UnitRow]:
    limits = {each.name: (str(each.objective), each.most) for each in one.needs.accuracy}
    limits["availability"] = ("fraction of correct attitudes", one.needs.min_availability)
    for name, (statistic, limit) in limits.items():
        ages = tuple(each[name] for each in found)
        yield UnitRow(one.name, name, statistic, limit, least, ages)


def unit_values(found: UnitVerification) -> dict[str, Any]:
    """A verification by yields for JSON; errors in arcsecond, availability as a fraction."""
    return {
        "verdict": found.answer.value,
        "units": found.count,
        "trials_each": found.trials,
        "not_judged": list(found.left),
        "wrong_verdict_probability": found.alpha,
        "requirements": [
            {
                "condition": one.condition,
                "requirement": one.name,
                "statistic": one.statistic,
                "limit": one.limit / (1.0 if one.name == "availability" else arcsec),
                "least_yield": one.least,
                "ages": [
                    {
                        "age_years": each.age / YEAR,
                        "yield": each.share.value,
                        "bounds": [each.share.low, each.share.high],
                        "verdict": each.answer.value,
                        "units_needed": each.needed,
                    }
                    for each in one.ages
                ],
            }
            for one in found.rows
        ],
    }


def unit_text(found: UnitVerification) -> str:
    """The table of yields, begin and end of life side by side, and what it means."""
    ages = [f"{each.age / YEAR:g} yr" for each in found.rows[0].ages]
    head = ["condition", "requirement", "limit"]
    table = [[*head, *(cell for age in ages for cell in (f"yield, {age} (%)", "verdict"))]]
    for one in found.rows:
        unit = 0.01 if one.name == "availability" else arcsec
        row = [one.condition, one.name, f"{one.limit / unit:.4g}"]
        for each in one.ages:
            value, low, high = (100 * part for part in (each.share.value, each.share.low,
                                                        each.share.high))  # fmt: skip
            row += [f"{value:.1f} [{low:.1f}, {high:.1f}]", _written(each)]
        table.append(row)
    lines = aligned(table)
    statistics = dict.fromkeys(f"{one.name}: {one.statistic}" for one in found.rows)
    verdicts = ", ".join(f"{_shown(found.at(k))} at {age}" for k, age in enumerate(ages))
    return "\n".join([
        *lines, "", f"verdict: {verdicts}", *statistics,
        *(f"not judged: {reason}" for reason in found.left),
        f"of {found.count} units with {found.trials} trials each, {100 * found.rows[0].least:g} % "
        "must meet each limit with their own trials; a pass or a fail of all at an age is wrong "
        f"with a probability of at most {100 * found.alpha:g} %. Errors in arcsec, availability in "
        "%.",
    ])  # fmt: skip


def _shown(answer: Answer) -> str:
    return answer.value if answer is Answer.PASS else answer.value.upper()


def _written(one: YieldVerdict) -> str:
    if one.answer is not Answer.NOT_SHOWN:
        return _shown(one.answer)
    return f"{_shown(one.answer)}: " + (
        f"about {one.needed} units would do" if one.needed else "no number of units would do"
    )
