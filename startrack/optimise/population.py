"""Judged condition -> the units over which it is judged: the unit as designed, or drawn units.

The unit as designed is a population of one. Both have the same interface for engines: budgets,
trials, and requirements by fresh trials.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from startrack import verification
from startrack.budget import UnitBudgets
from startrack.core import Advance, Refused, Rows
from startrack.design import Accuracy, Campaign, Fidelity, Judged, OverUnits
from startrack.metrics import Interval
from startrack.optimise.budgets import ENVIRONMENTS, budget_or_refusal, budgets_of_units
from startrack.optimise.limit import Limit
from startrack.optimise.runner import FRESH, FRESH_UNIT, TrialRunner
from startrack.optimise.units import fresh_units, measured_units
from startrack.population import Units

LOOKS = 4  # looks at 1, 2, 4 and 8 times the fresh trials; by hand: trials against decisions
UNIT_LOOKS = 2  # looks at 1 and 2 times the fresh units; each unit needs its own plans


class FreshTrials(NamedTuple):
    """Numbers of the trials that are fresh in a round of a search; no other round uses them.

    first  number of the first trial
    unit   number of the first unit
    part   fraction of the probability of a wrong bound that this round may use
    """

    first: int = FRESH
    unit: int = FRESH_UNIT
    part: float = 1.0

    @classmethod
    def of_round(cls, number: int, campaign: Campaign) -> FreshTrials:
        """The fresh trials of a round, counted from 0.

        Round k has 1 / 2^k of the probability of error, so that all rounds together have twice the
        probability of the first round.
        """
        trials = campaign.fresh_trials * 2 ** (LOOKS - 1)
        units = campaign.fresh_units * 2 ** (UNIT_LOOKS - 1)
        return cls(FRESH + number * trials, FRESH_UNIT + number * units, 0.5**number)


FIRST_ROUND = FreshTrials()


class Confirmed(NamedTuple):
    """A requirement on the best design, by fresh trials.

    bounds   bounds of its value
    margin   margin by the bound that must hold
    decided  whether the trials decide it
    found    margin of the measured value; for the error over units, the deciding unit's margin
    trials   number of trials
    """

    bounds: Interval
    margin: float
    decided: bool
    found: float
    trials: int


def population_of(condition: Judged) -> UnitAsDesigned | DrawnUnits:
    """Population of units over which a condition is judged."""
    if condition.units is None:
        return UnitAsDesigned(condition)
    return DrawnUnits(condition, condition.units)


@dataclass(frozen=True)
class UnitAsDesigned:
    """The unit as designed as a population of one, with consecutive trials.

    fraction  fraction of the units that must not exceed the error; arbitrary for one unit
    looks     number of doublings of fresh trials, plus one
    """

    fraction: ClassVar[float] = 0.5
    looks: ClassVar[int] = LOOKS

    condition: Judged

    def parts(self, workers: int) -> list[range]:
        """Units in parts; a worker computes the budgets of a part."""
        return [range(1)]

    def budgets(self, seed: int, part: range) -> UnitBudgets | Refused:
        """Analytic budgets of some units, or why one has no attitude."""
        budget = budget_or_refusal(self.condition.case)
        return budget if isinstance(budget, Refused) else UnitBudgets.of_one(budget)

    def tried(self, outcomes: Rows) -> int:
        """Number of units in the outcomes of trials."""
        return 1

    def first_trials(
        self, trials: int, fidelity: Fidelity, runner: TrialRunner, watch: Advance | None = None
    ) -> Rows:
        """The outcomes of about `trials` trials of the search, the same for all designs.

        watch  called with the number of trials that were just done
        """
        return runner.run(self.condition.case, trials, fidelity, progress=watch)

    def few_fresh(self, campaign: Campaign, runner: TrialRunner) -> Rows:
        """The outcomes of trials that no tuning used; their number is as for a tried design."""
        return runner.run(self.condition.case, campaign.most_trials, campaign.fidelity, FRESH)

    def fresh(
        self,
        campaign: Campaign,
        runner: TrialRunner,
        fidelity: Fidelity,
        fresh: FreshTrials = FIRST_ROUND,
        done: int = 0,
        watch: Advance | None = None,
    ) -> Rows:
        """Outcomes of trials that no tuning used: the campaign's number, or `done` further ones.

        done   number of trials before these
        watch  called with the number of trials that were just done
        """
        # Repeated numbers would repeat the attitudes.
        count, first = done or campaign.fresh_trials, fresh.first + done
        return runner.run(self.condition.case, count, fidelity, first, watch)

    def most_fresh(self, campaign: Campaign) -> int:
        """Number of fresh trials at the last look."""
        return campaign.fresh_trials * 2 ** (LOOKS - 1)

    def limit(self, accuracy: Accuracy, trials: int, tail: float) -> Limit:
        """The limit on an error, with the margin that fresh trials can confirm."""
        return Limit.of_error(accuracy.objective.fraction, trials, tail)

    def confirmed(
        self,
        claim: verification.Claim,
        outcomes: Rows,
        campaign: Campaign,
        runner: TrialRunner,
        tails: tuple[float, float],
    ) -> Confirmed:
        """Result of the fresh trials that count for a requirement."""
        return _by_all_trials(claim, outcomes, runner.seed, tails)


def _by_all_trials(
    claim: verification.Claim, outcomes: Rows, seed: int, tails: tuple[float, float]
) -> Confirmed:
    """Result of a requirement by trials; the units of the trials do not matter."""
    by_region = claim.sky == "worst"
    boresight = verification.boresights(seed, outcomes) if by_region else np.empty((0, 3))
    bounds = claim.bounds(outcomes, boresight, *tails)
    shown = bounds.high if claim.accuracy else bounds.low
    decided = claim.answer(bounds) is not verification.Answer.NOT_SHOWN
    found = claim.margin(bounds.value)
    return Confirmed(bounds, claim.margin(shown), decided, found, len(outcomes))


@dataclass(frozen=True)
class DrawnUnits:
    """Drawn units, each with some trials; the interface is that of `UnitAsDesigned`."""

    looks: ClassVar[int] = UNIT_LOOKS

    condition: Judged
    over: OverUnits

    @property
    def fraction(self) -> float:
        """See `UnitAsDesigned`."""
        return self.over.fraction

    def parts(self, workers: int) -> list[range]:
        """See `UnitAsDesigned`."""
        count = self.over.count
        # With a lens table all units share the images and the response of one unit, which take
        # most of the time.
        shared = self.condition.case.instrument.optics.tabulated
        size = count if shared else math.ceil(count / workers)
        return [range(at, min(at + size, count)) for at in range(0, count, size)]

    def budgets(self, seed: int, part: range) -> UnitBudgets | Refused:
        """See `UnitAsDesigned`."""
        return budgets_of_units(self.condition.case, seed, self.over.age, part.start, len(part))

    def tried(self, outcomes: Rows) -> int:
        """See `UnitAsDesigned`."""
        return math.ceil(len(outcomes) / self.over.trials)

    def first_trials(
        self, trials: int, fidelity: Fidelity, runner: TrialRunner, watch: Advance | None = None
    ) -> Rows:
        """See `UnitAsDesigned`."""
        per_unit = self.over.trials
        how = Units(per_unit, min(ENVIRONMENTS, per_unit), self.over.age, exact=True)
        count = min(math.ceil(trials / per_unit), self.over.count)
        return runner.run(
            self.condition.case, count * per_unit, fidelity, progress=watch, units=how
        )

    def few_fresh(self, campaign: Campaign, runner: TrialRunner) -> Rows:
        """See `UnitAsDesigned`."""
        return fresh_units(self.condition, campaign, runner, self.over.count)

    def fresh(
        self,
        campaign: Campaign,
        runner: TrialRunner,
        fidelity: Fidelity,
        fresh: FreshTrials = FIRST_ROUND,
        done: int = 0,
        watch: Advance | None = None,
    ) -> Rows:
        """See `UnitAsDesigned`; always in the campaign's fidelity."""
        units = done // campaign.trials_per_unit
        count, first = units or campaign.fresh_units, fresh.unit + units
        return fresh_units(self.condition, campaign, runner, count, first, watch)

    def most_fresh(self, campaign: Campaign) -> int:
        """See `UnitAsDesigned`."""
        return campaign.fresh_units * campaign.trials_per_unit * 2 ** (UNIT_LOOKS - 1)

    def limit(self, accuracy: Accuracy, trials: int, tail: float) -> Limit:
        """See `UnitAsDesigned`; a yield decides, so the needed margin is known only after
        trials."""
        return Limit(1.0, 1.0, chance=False)

    def confirmed(
        self,
        claim: verification.Claim,
        outcomes: Rows,
        campaign: Campaign,
        runner: TrialRunner,
        tails: tuple[float, float],
    ) -> Confirmed:
        """As `UnitAsDesigned`; the fraction of units that meet a limit confirms an error."""
        if claim.accuracy is None:
            return _by_all_trials(claim, outcomes, runner.seed, tails)
        asked, objective = verification.YieldClaim(self.fraction), claim.accuracy.objective
        measured = measured_units(objective, self.condition, outcomes, campaign, runner)
        errors, part = measured.denoised, measured.effective_fraction(claim.limit, runner.seed)
        bounds = asked.bounds(errors <= claim.limit, *tails, part)
        decided = asked.answer(bounds) is not verification.Answer.NOT_SHOWN
        worst = float(np.sort(errors)[::-1][asked.most_beyond(len(errors), tails[0])])
        found = claim.margin(worst)
        return Confirmed(bounds, asked.margin(bounds.low), decided, found, len(outcomes))
