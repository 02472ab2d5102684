"""Campaign: objective, limits, conditions and variables of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from startrack.core import (
    POSITIVE,
    Parameters,
    Range,
    Refused,
    non_negative,
    parameter,
    parse,
    whole,
)
from startrack.design.case import Case, Fidelity
from startrack.design.conditions import Condition, Judged, OverUnits, judged
from startrack.design.objective import MEANS, Objective
from startrack.design.requirements import COSTS, Accuracy, Requirements
from startrack.design.variables import Choice, Link, Variable

AGES = ("begin", "end")
UNIT_TRIALS = 20  # of each fresh unit: its rms is known to 11 %; chosen by hand


def fewest_trials_beyond(objective: Objective) -> int:
    """Number of trials of which on average one exceeds the level of an objective; 2 for an rms."""
    if objective.fraction is None:
        return 2
    return max(2, math.ceil(1 / (1 - objective.fraction) - 1e-9))


class Campaign(Parameters):
    """The question that is put to a design."""

    OLD_KEYS: ClassVar[Mapping[str, str]] = {"prospects": "analytic_evaluations"}

    variables: tuple[Variable, ...] = parameter("what may change", default=())
    links: tuple[Link, ...] = parameter("what follows them", default=())
    choices: tuple[Choice, ...] = parameter(
        "what may be one of several: each combination is a branch of its own", default=()
    )
    requirements: Requirements = parameter("what must hold", default_factory=Requirements)
    conditions: tuple[Condition, ...] = parameter(
        "rates, backgrounds and ages at which the design is judged, besides its own", default=()
    )
    objective: str = parameter(
        '"across", "about" or "both", whose rms error is made small; with a fraction in '
        'percent, as in "across-99.73", the error that this share of trials does not exceed by its '
        'length; as in "across-99.73 per axis", that this share of errors about single axes does '
        'not exceed; "both radial": the root of the sum of the squares about all axes; as in '
        '"across + 0.1 about", a weighted sum of rms errors',
        default="across",
    )
    unknown_draws: int = parameter(
        "draws of what is not known in which the design is judged, too, each a condition of "
        "weight 1 with one value of each unknown; 0: all unknowns stay at their middle",
        limit=Range(0, 200),
        default=0,
    )
    conditions_mean: str = parameter(
        "how the objective counts conditions, by their weights: their geometric, arithmetic or "
        "quadratic mean; or the worst of those that have a weight",
        limit=Range(choices=MEANS),
        default=MEANS[0],
    )
    minimise: str = parameter(
        '"error": the objective; or a cost by the models of the requirements, under their limits, '
        "which trials of errors and availability decide as ever",
        limit=Range(choices=("error", *COSTS)),
        default="error",
    )
    units: float | None = parameter(
        "fraction of the units of the design, such as 0.95, that must be as good: the objective "
        "is then the error that this fraction does not exceed, and a limit on an error must "
        "hold for it; None: of the unit as designed alone",
        default=None,
    )
    age: str = parameter(
        'of these units: "begin" or "end" of life, or a time such as "3 yr"', default="end"
    )
    unit_count: int = parameter(
        "units that the analytic budget of each design is computed for",
        limit=Range(2, 1000),
        default=20,
    )
    fresh_units: int = parameter(
        "units on which start and best are compared at the end", limit=Range(2, 10**5), default=60
    )
    unit_trials: int | None = parameter(
        "trials of each of these; None: 20. More where a level of the objective or of a "
        "requirement needs them to have one trial beyond it, which are 371 for 99.73 %",
        limit=Range(2, 10**4),
        default=None,
    )
    fidelity: Fidelity = parameter(
        "of the trials that a search is done with; the winner is verified on frames",
        default=Fidelity.WINDOW,
    )
    trials: int = parameter("of each design at first", limit=Range(2, 10**6), default=50)
    most_trials: int = parameter(
        "of each design at last; the number doubles between", limit=Range(high=10**6), default=200
    )
    evaluations: int = parameter(
        "designs at most that are tried by trials, in all branches together; three more "
        "in each round that follows fresh trials in which a limit is missed",
        limit=Range(1, 10**6),
        default=120,
    )
    analytic_evaluations: int = parameter(
        "designs at most of each branch that the analytic budget evaluates, before the first trial",
        limit=Range(0, 10**6),
        default=200,
    )
    search: str = parameter(
        'how designs are chosen for the analytic budget: "emulator", where Gaussian processes '
        "through all that are known expect most, or algorithms of nlopt one after the other, such "
        'as "direct+sbplx" or "GN_ISRES", each with as many evaluations; or user code, '
        "see docs/extensions.md",
        limit=Range(code="searches", free=True),
        default="emulator",
    )
    precision: float = parameter(
        "fraction of the objective that is worth no further evaluation: a search ends when it "
        "expects to gain less, and each variable is known as well as that bears",
        limit=Range(1e-4, 0.5),
        default=0.01,
    )
    sample_trials: int = parameter(
        "trials for each design that the tolerance region is computed from",
        limit=Range(2, 10**6),
        default=160,
    )
    fresh_trials: int = parameter(
        "frames on which start and best are compared at the end",
        limit=Range(2, 10**6),
        default=1000,
    )
    margin: float = parameter(
        "fraction by which the error may grow in the tolerance region of `sample`",
        limit=POSITIVE,
        default=0.2,
    )
    span: float = parameter(
        "half the width of that region's box, as a fraction of each variable's range",
        limit=Range(0.001, 0.5),
        default=0.15,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        Objective.read(self.objective)
        whole(self.trials, 10**6, most_trials=self.most_trials)
        self._check_units()

    def error(self, text: str) -> Objective:
        """A statistic of the error, over the conditions as the campaign counts them."""
        return replace(Objective.read(text), mean=self.conditions_mean)

    @property
    def goal(self) -> Objective:
        """Statistic of the error that the campaign names, whether or not a search minimises it."""
        return self.error(self.objective)

    @property
    def of_errors(self) -> Campaign:
        """The campaign whose objective is the error."""
        return replace(self, minimise="error")

    def cost(self, case: Case) -> float | None:
        """The cost that is minimised instead of the error; None where the error is.

        Returns  SI, in the unit of `COSTS`
        """
        if self.minimise == "error":
            return None
        cost = self.requirements.cost_named(self.minimise, case)
        if not cost > 0:
            raise Refused(f"{self.minimise} must be positive to be made small, got {cost:g}")
        return cost

    @property
    def made_small(self) -> tuple[str, str]:
        """The minimised quantity in words, and its unit."""
        if self.minimise == "error":
            return str(self.goal), "arcsec"
        return self.minimise, COSTS[self.minimise]

    def _check_units(self) -> None:
        if self.age not in AGES:
            try:
                non_negative(age=parse(self.age, "s"))
            except ValueError:
                said = f"age must be begin, end or a time such as 3 yr, got {self.age!r}"
                raise Refused(said) from None
        if self.units is None:
            return
        if not 0 < self.units < 1:
            raise Refused(f"units must lie in (0, 1), such as 0.95, got {self.units}")
        if self.requirements.sky == "worst":
            raise Refused("units must be left out where requirements.sky is worst")

    @property
    def trials_of_level(self) -> int:
        """Trials of a unit of which on average one exceeds the largest level; 2 without a level."""
        objectives = [Objective.read(self.objective), *(limit.objective for limit in self.limited)]
        return max(fewest_trials_beyond(objective) for objective in objectives)

    @property
    def limited(self) -> tuple[Accuracy, ...]:
        """The errors that are limited, in any condition."""
        own = self.requirements
        needs = [own, *(condition.requirements(own) for condition in self.conditions)]
        return tuple(accuracy for need in needs for accuracy in need.accuracy)

    @property
    def trials_per_unit(self) -> int:
        """Trials of each fresh unit."""
        return max(self.unit_trials or UNIT_TRIALS, self.trials_of_level)

    def over_units(self, case: Case) -> OverUnits | None:
        """The units over which a design is judged; None: it is judged as designed.

        Raises  ValueError if units are asked and those of the design are all alike.
        """
        if self.units is None:
            return None
        if not case.differs:
            raise Refused(
                "campaign.units needs a design with [[variation]] tables, [instrument.residual] or "
                "[instrument.detector.age]"
            )
        ends = {"begin": 0.0, "end": case.end_of_life}
        age = ends[self.age] if self.age in ends else parse(self.age, "s")
        per_unit = math.ceil(self.most_trials / self.unit_count)
        return OverUnits(self.units, age, self.unit_count, per_unit)

    def goal_of(self, case: Case) -> str:
        """The statistic of the error of a design, in words: over its units where these are asked.

        Raises  as `over_units`
        """
        over = self.over_units(case)
        return f"{self.goal} {over.words}" if over else str(self.goal)

    def judged(self, case: Case) -> tuple[Judged, ...]:
        """A design in all conditions in which it is judged; see `startrack.design.judged`.

        Where units are asked, conditions without a weight in the objective and without a limit on
        an error are those of the unit as designed.
        """
        units, every = self.over_units(case), judged(case, self.requirements, self.conditions)
        if units is None:
            return every
        return tuple(
            condition._replace(units=units)
            if condition.weight or condition.needs.accuracy
            else condition
            for condition in every
        )
