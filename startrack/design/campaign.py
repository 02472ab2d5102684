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
UNIT_TRIALS = 20  # trials of each fresh unit: they give its rms to 11 %; chosen by hand


def fewest_trials_beyond(objective: Objective) -> int:
    """Number of trials of which on average one exceeds the level of an objective; 2 for an rms."""
    if objective.fraction is None:
        return 2
    return max(2, math.ceil(1 / (1 - objective.fraction) - 1e-9))


class Campaign(Parameters):
    """The question that is asked about a design: what to minimise, over what, and how."""

    OLD_KEYS: ClassVar[Mapping[str, str]] = {"prospects": "analytic_evaluations"}

    variables: tuple[Variable, ...] = parameter("what may change", default=())
    links: tuple[Link, ...] = parameter("what follows them", default=())
    choices: tuple[Choice, ...] = parameter(
        "parameters with a list of values: each combination is a separate branch", default=()
    )
    requirements: Requirements = parameter("what must hold", default_factory=Requirements)
    conditions: tuple[Condition, ...] = parameter(
        "rates, backgrounds and ages at which the design is also judged", default=()
    )
    objective: str = parameter(
        'error to be minimised. "across", "about" or "both": rms per axis; "across-99.73": length '
        'of the error that 99.73 % of the trials do not exceed; "across-99.73 per axis": error '
        'about a single axis that 99.73 % do not exceed; "both radial": rms of the length over all '
        'axes; "across + 0.1 about": a weighted sum of rms errors',
        default="across",
    )
    unknown_draws: int = parameter(
        "number of draws of the unknown values in which the design is also judged; each draw is a "
        "condition of weight 1; 0: all unknowns stay at their middle",
        limit=Range(0, 200),
        default=0,
    )
    conditions_mean: str = parameter(
        "how the objective combines conditions: their geometric, arithmetic or quadratic mean by "
        "their weights; or the worst of those that have a weight",
        limit=Range(choices=MEANS),
        default=MEANS[0],
    )
    minimise: str = parameter(
        '"error": the objective; or a cost by the models of the requirements; their limits then '
        "hold, and trials decide the limits on errors and availability",
        limit=Range(choices=("error", *COSTS)),
        default="error",
    )
    units: float | None = parameter(
        "fraction of the units of the design, such as 0.95, over which errors are judged: the "
        "objective is the error that this fraction of the units does not exceed, and limits on "
        "errors must hold for this fraction; None: only the unit as designed is judged",
        default=None,
    )
    age: str = parameter(
        'age of these units: "begin" or "end" of life, or a time such as "3 yr"', default="end"
    )
    unit_count: int = parameter(
        "number of units for which the analytic budget of each design is computed",
        limit=Range(2, 1000),
        default=20,
    )
    fresh_units: int = parameter(
        "number of units on which start and best design are compared at the end",
        limit=Range(2, 10**5),
        default=60,
    )
    unit_trials: int | None = parameter(
        "number of trials of each of these units; None: 20. If the objective or a requirement is a "
        "level, there are enough trials for one of them to exceed it: 371 for 99.73 %",
        limit=Range(2, 10**4),
        default=None,
    )
    fidelity: Fidelity = parameter(
        "fidelity of the trials of a search; the best design is verified on frames",
        default=Fidelity.WINDOW,
    )
    trials: int = parameter(
        "initial number of trials of each design", limit=Range(2, 10**6), default=50
    )
    most_trials: int = parameter(
        "final number of trials of each design; the number doubles until then",
        limit=Range(high=10**6),
        default=200,
    )
    evaluations: int = parameter(
        "largest number of designs that are judged by trials, over all branches; each round after "
        "fresh trials that miss a limit adds three",
        limit=Range(1, 10**6),
        default=120,
    )
    analytic_evaluations: int = parameter(
        "largest number of designs of each branch that the analytic budget evaluates, before the "
        "first trial",
        limit=Range(0, 10**6),
        default=200,
    )
    search: str = parameter(
        'how designs are chosen for the analytic budget: "emulator", the largest gain expected by '
        "Gaussian processes that are fitted to all evaluated designs; or algorithms of nlopt one "
        'after the other, such as "direct+sbplx" or "GN_ISRES", each with this number of '
        "evaluations; or user code, see docs/extensions.md",
        limit=Range(code="searches", free=True),
        default="emulator",
    )
    precision: float = parameter(
        "tolerance of the search, as a fraction of the objective: it ends when the expected gain "
        "is smaller, and each variable is known with the accuracy that this allows",
        limit=Range(1e-4, 0.5),
        default=0.01,
    )
    sample_trials: int = parameter(
        "number of trials of each design from which the tolerance region is computed",
        limit=Range(2, 10**6),
        default=160,
    )
    fresh_trials: int = parameter(
        "number of frames on which start and best design are compared at the end",
        limit=Range(2, 10**6),
        default=1000,
    )
    margin: float = parameter(
        "fraction by which the error may grow in the tolerance region of `sample`",
        limit=POSITIVE,
        default=0.2,
    )
    span: float = parameter(
        "half the width of the box of this region, as a fraction of each variable's range",
        limit=Range(0.001, 0.5),
        default=0.15,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        Objective.read(self.objective)
        whole(self.trials, 10**6, most_trials=self.most_trials)
        self._check_units()
        chosen = [choice.name for choice in self.choices]
        changed = chosen + [variable.name for variable in self.variables]
        changed += [link.name for link in self.links]
        for name in chosen:
            if changed.count(name) > 1:
                raise Refused(
                    "campaign.choices must name a parameter once, and none of the variables and "
                    f"links, got {name} {changed.count(name)} times"
                )

    def error(self, text: str) -> Objective:
        """A statistic of the error, with the campaign's mean over conditions."""
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
        """The cost that is minimised instead of the error; None if the error is minimised.

        Returns  SI, in the unit of `COSTS`
        """
        if self.minimise == "error":
            return None
        cost = self.requirements.cost_named(self.minimise, case)
        if not cost > 0:
            raise Refused(f"{self.minimise} must be positive to be minimised, got {cost:g}")
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
            raise Refused("units must be left out if requirements.sky is worst")

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

        Raises  ValueError if units are required and all units of the design are equal.
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
        """The statistic of the error of a design, in words; over its units if these are required.

        Raises  as `over_units`
        """
        over = self.over_units(case)
        return f"{self.goal} {over.words}" if over else str(self.goal)

    def judged(self, case: Case) -> tuple[Judged, ...]:
        """A design in all conditions in which it is judged; see `startrack.design.judged`.

        If units are required, conditions that have neither a weight in the objective nor a limit on
        an error are judged for the unit as designed.
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
