"""Campaign: what a study of a design is asked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from startrack.core import positive, whole, within
from startrack.design.case import Case, Fidelity
from startrack.design.choice import Choice
from startrack.design.conditions import Condition, Judged, judged
from startrack.design.objective import Objective
from startrack.design.requirements import Requirements
from startrack.design.variables import Link, Variable


@dataclass(frozen=True)
class Campaign:
    """The question that is put to a design.

    variables      what may change
    links          what follows them
    choices        what may be one of several: each combination is a branch of its own
    requirements   what must hold
    conditions     rates, backgrounds and ages at which the design is judged, besides its own
    objective      "across", "about" or "both", whose rms error is made small; with a fraction in
                   percent, as in "across-99.73", the error that so many trials do not exceed by its
                   length; as in "across-99.73 per axis", that so many errors about single axes do
                   not exceed. Of several conditions, the geometric mean by their weights
    fidelity       of the trials that a search is done with; the winner is verified on frames
    trials         of each design at first
    most_trials    of each design at last; the number doubles between
    evaluations    designs that an optimiser may try, in all branches together; each branch has two
                   and one a round of their race at least
    analytic_evaluations  designs that the analytic budget evaluates before the first trial; 0 to
                   begin at the design
    sample_trials  trials for each design that the tolerance region is computed from
    fresh_trials   frames on which start and best are compared at the end
    margin         fraction by which the error may grow in the tolerance region of `sample`
    span           half the width of that region's box, as a fraction of each variable's range
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {"prospects": "analytic_evaluations"}

    variables: tuple[Variable, ...] = ()
    links: tuple[Link, ...] = ()
    choices: tuple[Choice, ...] = ()
    requirements: Requirements = field(default_factory=Requirements)
    conditions: tuple[Condition, ...] = ()
    objective: str = "across"
    fidelity: Fidelity = Fidelity.WINDOW
    trials: int = 50
    most_trials: int = 200
    evaluations: int = 120
    analytic_evaluations: int = 200
    sample_trials: int = 160
    fresh_trials: int = 1000
    margin: float = 0.2
    span: float = 0.15

    def __post_init__(self) -> None:
        Objective.read(self.objective)
        whole(2, 10**6, trials=self.trials, fresh_trials=self.fresh_trials)
        whole(self.trials, 10**6, most_trials=self.most_trials)
        whole(2, 10**6, sample_trials=self.sample_trials)
        whole(1, 10**6, evaluations=self.evaluations)
        whole(0, 10**6, analytic_evaluations=self.analytic_evaluations)
        positive(margin=self.margin)
        within(0.001, 0.5, span=self.span)

    def judged(self, case: Case) -> tuple[Judged, ...]:
        """A design in all conditions in which it is judged; see `startrack.design.judged`."""
        return judged(case, self.requirements, self.conditions)
