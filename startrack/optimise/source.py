"""DesignSpace and campaign -> inputs of an explorer: forecasts, costs, conditions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy

from startrack.core import Advance, Flags, Floats, Refused
from startrack.design import Campaign, Case, DesignSpace, Requirements, found_at
from startrack.metrics import ARCSEC, DisplayUnit
from startrack.optimise.emulators import WholeNumbers
from startrack.optimise.evaluate import Evaluation, Foresight, evaluate, foresee_all, missed
from startrack.optimise.forecast import name_by_condition
from startrack.optimise.ledger import Ledger
from startrack.optimise.priors import LawPrior
from startrack.optimise.runner import TrialRunner
from startrack.verification import cost_margins


class DesignSource(WholeNumbers, Protocol):
    """Designs in the unit cube, and their expected figures without trials."""

    @property
    def names(self) -> Sequence[str]:
        """Names of the variables, in the order of the coordinates."""

    @property
    def seed(self) -> int:
        """Seed of random proposals."""

    @property
    def search(self) -> str:
        """Search of designs: "emulator", or algorithms of nlopt."""

    @property
    def precision(self) -> float:
        """Relative change of the objective below which no further forecast is made."""

    @property
    def conditions(self) -> Mapping[str, float]:
        """Weights of the conditions, by their names; a design may be forecast in some alone."""

    @property
    def rooms(self) -> Mapping[str, float]:
        """Largest allowed probability of failure, of margins that are probabilities."""

    def foresee(self, points: Sequence[Floats], enough: float) -> list[Foresight]:
        """Forecasts of designs; if the score exceeds `enough`, only in conditions with a weight."""

    def complete(self, point: Floats, known: Foresight) -> Foresight:
        """The forecast of a design in all conditions."""

    def cost_missed(self, point: Floats) -> float:
        """Excess of a design's costs over their limits. Raises Refused if there is no design."""


class StudiedSource(DesignSource, Protocol):
    """Designs around a design, for tolerances and sensitivities."""

    @property
    def start(self) -> Floats:
        """Unit-cube coordinates of the design as it is."""

    @property
    def start_values(self) -> Mapping[str, float]:
        """Values of the variables in the design as it is, SI."""

    @property
    def margin(self) -> float:
        """Fraction by which the objective may grow in the tolerance region."""

    @property
    def span(self) -> float | Floats:
        """Half the width of the box of this region, as a fraction of each variable's range."""

    @property
    def laws(self) -> Mapping[str, str]:
        """Laws of variables that are not known, in words, by names."""

    def log_prior(self, points: Floats) -> Floats:
        """Logarithm (n,) of the density of designs (n, d) before any requirement."""

    @property
    def unit(self) -> DisplayUnit:
        """Unit of the objective."""

    @property
    def ledger(self) -> Ledger:
        """Ledger of computed results."""

    def values(self, point: Floats) -> Mapping[str, float]:
        """Values of the variables at a point, SI."""

    def value(self, point: Floats, name: str) -> float:
        """Value of a variable in the design at a point, SI."""

    def shown(self, point: Floats | None = None) -> Mapping[str, str]:
        """Values and units as texts, by names; None: values of the unchanged design."""

    def labels(self) -> Mapping[str, str]:
        """The variables as they are called in tables, by names."""

    def costs(self, point: Floats) -> Mapping[str, float]:
        """Costs of a design, by their names with units."""

    def foresee_any(
        self, points: Sequence[Floats], weighted: bool = False, progress: Advance | None = None
    ) -> list[Foresight]:
        """Forecasts of designs, without limits of cost.

        weighted  only in conditions that have a weight
        progress  called with the number of designs that were just forecast, or are known
        """

    def evaluate(self, point: Floats, known: Foresight) -> Evaluation:
        """Evaluate a design by trials, with its known forecast."""


@dataclass(frozen=True, eq=False)
class TrackerSource:
    """A star tracker's designs, by their error budgets.

    runner  computes the forecasts and keeps them; None: this process
    seed    of units and proposals, where there is no runner
    priors  variables of the space that have a law, in which tolerances are sampled
    """

    space: DesignSpace
    campaign: Campaign
    runner: TrialRunner | None = None
    own_seed: int = 1
    priors: Sequence[LawPrior] = ()

    @property
    def names(self) -> Sequence[str]:
        """Names of the variables."""
        return [variable.name for variable in self.space.variables]

    @property
    def seed(self) -> int:
        """Seed of the runner, if the source has a runner."""
        return self.runner.seed if self.runner else self.own_seed

    @property
    def search(self) -> str:
        """The setting of the campaign."""
        return self.campaign.search

    @property
    def precision(self) -> float:
        """The setting of the campaign."""
        return self.campaign.precision

    @property
    def start(self) -> Floats:
        """The value of the case."""
        return self.space.start

    @property
    def start_values(self) -> Mapping[str, float]:
        """The value of the case."""
        return {name: found_at(self.space.case, name) for name in self.names}

    @property
    def margin(self) -> float:
        """The setting of the campaign."""
        return self.campaign.margin

    @property
    def span(self) -> Floats:
        """The setting of the campaign; the whole range for a variable that has a law."""
        known = {prior.variable.name for prior in self.priors}
        return np.array([1.0 if name in known else self.campaign.span for name in self.names])

    @property
    def laws(self) -> Mapping[str, str]:
        """The laws of the priors, by name of the variable."""
        return {prior.variable.name: str(prior.unknown) for prior in self.priors}

    def log_prior(self, points: Floats) -> Floats:
        """Logarithm of the density of the laws; all other variables are uniform on their scale."""
        density = np.zeros(len(points))
        for prior in self.priors:
            name = prior.variable.name
            low, high = (self.space.values(np.full(len(self.names), u))[name] for u in (0.0, 1.0))
            at, ratio = points[:, self.names.index(name)], prior.variable.scale == "log"
            value = low * (high / low) ** at if ratio else low + (high - low) * at
            density += prior.log_density(value)
        return density

    @property
    def unit(self) -> DisplayUnit:
        """The unit of errors."""
        return ARCSEC

    @property
    def ledger(self) -> Ledger:
        """Ledger of the runner, if the source has a runner."""
        return self.runner.ledger if self.runner else Ledger()

    @cached_property
    def conditions(self) -> Mapping[str, float]:
        """The setting of the campaign."""
        judged = self.campaign.judged(self.space.case)
        return {condition.name: condition.weight for condition in judged}

    @cached_property
    def rooms(self) -> Mapping[str, float]:
        """Rooms of the availabilities."""
        return {
            name: 1 - condition.needs.min_availability
            for condition in self.campaign.judged(self.space.case)
            for name in name_by_condition(condition.name, {"availability": 0.0})
            if condition.needs.min_availability < 1
        }

    @property
    def whole(self) -> Flags:
        """Flags by the design space."""
        return self.space.whole

    def snapped(self, point: Floats) -> Floats:
        """Point by the design space."""
        return self.space.snapped(point)

    def foresee(self, points: Sequence[Floats], enough: float) -> list[Foresight]:
        """Forecasts by `foresee_all`."""
        return foresee_all(self.space, self.campaign, points, self.runner, self.own_seed, enough)

    def complete(self, point: Floats, known: Foresight) -> Foresight:
        """Forecast by `foresee_all` of the conditions that are not known yet."""
        [whole] = foresee_all(
            self.space, self.campaign, [point], self.runner, self.own_seed, known=known.conditions
        )
        return whole

    def values(self, point: Floats) -> Mapping[str, float]:
        """Labels by the design space."""
        return self.space.values(point)

    def value(self, point: Floats, name: str) -> float:
        """Value of the case at a point."""
        return found_at(self.space.design(point), name)

    def shown(self, point: Floats | None = None) -> Mapping[str, str]:
        """Text of a value in the unit of its parameter."""
        case = self.space.case if point is None else self.space.design(point)
        return self.space.text(case)

    def labels(self) -> Mapping[str, str]:
        """Values by the design space."""
        return self.space.labels()

    def costs(self, point: Floats) -> Mapping[str, float]:
        """Costs by `costs_of`."""
        return costs_of(self.campaign.requirements, self.space.design(point))

    def foresee_any(
        self, points: Sequence[Floats], weighted: bool = False, progress: Advance | None = None
    ) -> list[Foresight]:
        """Forecasts by `foresee_all`, of errors."""
        return foresee_all(
            self.space,
            self.campaign.of_errors,
            points,
            self.runner,
            self.own_seed,
            -math.inf if weighted else math.inf,
            math.inf,
            progress=progress,
        )

    def evaluate(self, point: Floats, known: Foresight) -> Evaluation:
        """Errors by `evaluate`, with the trials of the campaign as samples."""
        campaign, runner = self.campaign.of_errors, self.runner or TrialRunner(self.own_seed)
        return evaluate(self.space, campaign, point, runner, campaign.sample_trials, known=known)

    def cost_missed(self, point: Floats) -> float:
        """Excess of mass, power and other costs over their limits."""
        return missed(cost_margins(self.campaign.requirements, self.space.design(point)))


def costs_of(needs: Requirements, case: Case) -> dict[str, float]:
    """Costs of a star tracker, by names with their units."""
    return {
        "mass_kg": needs.mass(case),
        "power_w": needs.power(case),
        "calibration_h": needs.calibration_time(case) / 3600,
        "price": needs.cost(case),
    }


def affordable(source: DesignSource, random: np.random.Generator) -> Iterator[Floats]:
    """Points of a scrambled Sobol sequence; seven in eight meet the limits of cost."""
    size = len(source.names)
    sequence = scipy.stats.qmc.Sobol(size, rng=random)
    kept, tried = 0, 0
    while True:
        point, tried = np.asarray(sequence.random(1)[0]), tried + 1
        try:
            short = source.cost_missed(point)
        except Refused:
            continue
        if not short or kept % 8 == 7 or tried > 64 * size:
            kept += 1
            yield point
