"""Design, campaign, units -> a verdict on each requirement by its yield, at both ends of life."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from startrack.core import YEAR, Floats, Rows, arcsec
from startrack.design import Campaign, Case, Judged
from startrack.io import aligned
from startrack.metrics import Interval, bracketed, correct
from startrack.population import Units, unit_errors
from startrack.verification.cases import cases, counted
from startrack.verification.decide import Answer, YieldClaim, answer_of

UnitTrials = Callable[[Case, Units], Rows]
USUAL = 0.95  # required fraction of the units if a campaign does not state it
ENVIRONMENTS = 4  # environments of each unit; by hand: time against the error of a unit's rms


FEWEST_TRIALS = 8  # least number of trials of a unit; the rms of a unit has an error of 18 %


@dataclass(frozen=True)
class YieldVerdict:
    """The yield of a requirement in one condition at one age.

    age     second
    share   fraction of units that meet it, with the bounds that decide a fail and a pass
    answer  pass, fail or not shown
    needed  number of units that would decide it if it is not shown; None: unknown
    """

    age: float
    share: Interval
    answer: Answer
    needed: int | None


@dataclass(frozen=True)
class UnitRow:
    """A requirement in one condition, by its yields.

    condition  name of the condition
    name       name of the requirement
    statistic  limited statistic of each unit, in words
    limit      radian, or a fraction
    least      1, fraction of the units that must meet the limit
    ages       yields at the begin and at the end of life
    """

    condition: str
    name: str
    statistic: str
    limit: float
    least: float
    ages: tuple[YieldVerdict, ...]


@dataclass(frozen=True)
class StatedErrors:
    """Errors over units as datasheets state them, from trials in the design's own condition.

    age        second
    with_bias  (3,) radian, rms over all units and trials
    without    (3,) radian, rms without the mean error of each unit
    """

    age: float
    with_bias: Floats
    without: Floats


def _stated(outcomes: Rows, how: Units) -> StatedErrors:
    used = outcomes[outcomes["solved"] & ~outcomes["false"]]
    errors = np.column_stack([used[f"error_{axis}"] for axis in "xyz"])
    unit = used["trial"] // how.trials
    _, place, count = np.unique(unit, return_inverse=True, return_counts=True)
    mean = np.zeros((len(count), 3))
    np.add.at(mean, place, errors)
    left = errors - (mean / count[:, None])[place]
    # The mean of n trials contains 1 / n of their variance.
    freed = max(len(used) - len(count), 1)
    with_bias = np.sqrt((errors**2).sum(axis=0) / max(len(used), 1))
    return StatedErrors(how.age, with_bias, np.sqrt((left**2).sum(axis=0) / freed))


@dataclass(frozen=True)
class UnitVerification:
    """All verdicts by yields.

    rows    requirements, in the order of the conditions
    count   number of units
    trials  number of trials of each unit
    alpha   probability of any wrong pass, and of any wrong fail
    left    conditions that could not be judged, and why
    stated  errors at each age
    """

    rows: tuple[UnitRow, ...]
    count: int
    trials: int
    alpha: float
    left: tuple[str, ...]
    stated: tuple[StatedErrors, ...] = ()

    def at(self, number: int) -> Answer:
        """Answer of all requirements at one age: fail if one fails, pass if all pass."""
        return answer_of([row.ages[number].answer for row in self.rows], self.left)

    @property
    def answer(self) -> Answer:
        """Answer at the last age, the end of life."""
        return self.at(-1)


def trials_of_a_unit(campaign: Campaign) -> int:
    """Number of trials by which each unit is judged; at least 8, because their noise counts."""
    return max(campaign.trials_per_unit, FEWEST_TRIALS)


def verify_units(
    case: Case, campaign: Campaign, trials: UnitTrials, count: int, seed: int
) -> UnitVerification:
    """Judge each limited error, and the availability, by the units of a design.

    A unit meets a limit if the statistic of its own trials meets it. It meets the availability if
    the required fraction of its trials has a correct attitude. The yield must be at least `units`
    of the campaign, or 95 %. Each of the two ages is tested once, with the error probabilities of
    `Looks` for one look.

    trials    function that gives outcomes of trials of units of a case; these trials must not have
              been used to tune the design
    count     number of units
    seed      seed of these trials
    Raises    ValueError if all units of the design are equal, or if a trial cannot be run.
    Accuracy  a unit's rms across from n trials has a relative error of 1 / sqrt(4 n), which blurs
              the limit. A unit's availability has steps of 1 / n.
    """
    units = replace(campaign, units=campaign.units or USUAL)
    judged, left = cases(case, units)
    over = units.over_units(case)
    assert over is not None
    trials_each, alpha = trials_of_a_unit(units), 1 - campaign.requirements.confidence
    ages = tuple(dict.fromkeys((0.0, case.end_of_life)))
    claims = sum(len(condition.needs.accuracy) + 1 for condition in judged)
    tails = alpha, alpha / max(claims, 1)
    rows, stated = list[UnitRow](), list[StatedErrors]()
    for condition in judged:
        at_ages = list[dict[str, YieldVerdict]]()
        for age in ages:
            how = Units(trials_each, min(ENVIRONMENTS, trials_each), age)
            outcomes = counted(condition.needs, condition.case, seed, trials(condition.case, how))
            if len(stated) < len(ages):
                stated.append(_stated(outcomes, how))
            at_ages.append(dict(_at(condition, outcomes, how, over.fraction, tails)))
        rows += _rows(condition, at_ages, over.fraction)
    return UnitVerification(tuple(rows), count, trials_each, alpha, left, tuple(stated))


def _at(
    condition: Judged, outcomes: Rows, how: Units, least: float, tails: tuple[float, float]
) -> Iterator[tuple[str, YieldVerdict]]:
    unit, claim = outcomes["trial"] // how.trials, YieldClaim(least)
    met = {
        accuracy.name: unit_errors(accuracy.objective, outcomes, unit) <= accuracy.most
        for accuracy in condition.needs.accuracy
    }
    _, place = np.unique(unit, return_inverse=True)
    good = np.bincount(place, correct(outcomes, condition.needs.limits)) / np.bincount(place)
    met["availability"] = good >= condition.needs.min_availability
    for name, meets in met.items():
        bounds = claim.bounds(meets, *tails)
        answer = claim.answer(bounds)
        needed = claim.needed(bounds.value, *tails) if answer is Answer.NOT_SHOWN else None
        yield name, YieldVerdict(how.age, bounds, answer, needed)


def _rows(
    condition: Judged, at_ages: list[dict[str, YieldVerdict]], least: float
) -> Iterator[UnitRow]:
    needs = condition.needs
    limits = {limit.name: (str(limit.objective), limit.most) for limit in needs.accuracy}
    limits["availability"] = ("fraction of correct attitudes", needs.min_availability)
    for name, (statistic, limit) in limits.items():
        ages = tuple(verdicts[name] for verdicts in at_ages)
        yield UnitRow(condition.name, name, statistic, limit, least, ages)


def unit_values(verified: UnitVerification) -> dict[str, Any]:
    """A verification by yields for JSON; errors in arcsecond, availability as a fraction."""
    return {
        "verdict": verified.answer.value,
        "units": verified.count,
        "trials_each": verified.trials,
        "not_judged": list(verified.left),
        "wrong_verdict_probability": verified.alpha,
        "as_published_arcsec": [
            {
                "age_years": errors.age / YEAR,
                "with_bias": _pair(errors.with_bias),
                "without_bias": _pair(errors.without),
            }
            for errors in verified.stated
        ],
        "requirements": [
            {
                "condition": row.condition,
                "requirement": row.name,
                "statistic": row.statistic,
                "limit": row.limit / (1.0 if row.name == "availability" else arcsec),
                "least_yield": row.least,
                "ages": [
                    {
                        "age_years": verdict.age / YEAR,
                        "yield": verdict.share.value,
                        "bounds": [verdict.share.low, verdict.share.high],
                        "verdict": verdict.answer.value,
                        "units_needed": verdict.needed,
                    }
                    for verdict in row.ages
                ],
            }
            for row in verified.rows
        ],
    }


def _pair(errors: Floats) -> dict[str, float]:
    across = float(np.sqrt((errors[:2] ** 2).mean()))
    return {"across": across / arcsec, "about": float(errors[2]) / arcsec}


def _stated_text(errors: StatedErrors) -> str:
    parts = []
    for label, values in (("with bias", errors.with_bias), ("without", errors.without)):
        across, about = _pair(values).values()
        parts.append(
            f"{label} {across:.3g} across and {about:.3g} about (3 sigma {3 * across:.3g} and "
            f"{3 * about:.3g})"
        )
    return f"rms per axis over units at {errors.age / YEAR:g} yr, arcsec: {', '.join(parts)}"


def unit_text(verified: UnitVerification) -> str:
    """The table of yields, begin and end of life side by side, and its meaning."""
    ages = [f"{verdict.age / YEAR:g} yr" for verdict in verified.rows[0].ages]
    head = ["condition", "requirement", "limit"]
    table = [[*head, *(cell for age in ages for cell in (f"yield, {age} (%)", "verdict"))]]
    for row in verified.rows:
        unit = 0.01 if row.name == "availability" else arcsec
        cells = [row.condition, row.name, f"{row.limit / unit:.4g}"]
        for verdict in row.ages:
            cells += [bracketed(verdict.share, ".1f", 0.01), _written(verdict)]
        table.append(cells)
    lines = aligned(table)
    statistics = dict.fromkeys(f"{row.name}: {row.statistic}" for row in verified.rows)
    verdicts = ", ".join(f"{verified.at(k).in_capitals} at {age}" for k, age in enumerate(ages))
    return "\n".join(
        [
            f"verdict: {verdicts}",
            "",
            *lines,
            "",
            *statistics,
            *(_stated_text(errors) for errors in verified.stated),
            *(f"not judged: {reason}" for reason in verified.left),
            f"of {verified.count} units with {verified.trials} trials each, "
            f"{100 * verified.rows[0].least:g} % must meet each limit with their own trials; a "
            "pass or a fail of all at an age is wrong with a probability of at most "
            f"{100 * verified.alpha:g} %. Errors in arcsec, availability in %.",
        ]
    )


def _written(verdict: YieldVerdict) -> str:
    if verdict.answer is not Answer.NOT_SHOWN:
        return verdict.answer.in_capitals
    if not verdict.needed:
        return f"{verdict.answer.in_capitals}: these units do not tell how many would do"
    return f"{verdict.answer.in_capitals}: about {verdict.needed} units would do"
