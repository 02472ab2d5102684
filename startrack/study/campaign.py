"""Campaign: what an optimisation or a sampling is asked to do."""

from __future__ import annotations

from dataclasses import dataclass, field

from startrack.case import Fidelity
from startrack.checks import one_of, positive, whole, within
from startrack.study.box import Variable
from startrack.study.requirements import Requirements


@dataclass(frozen=True)
class Campaign:
    """The question that is put to a design.

    variables      what may change
    requirements   what must hold
    objective      "across" or "about": whose rms error is made small
    fidelity       how much of each trial is made: "frame", "window" or "covariance"
    trials         Monte Carlo trials for each design
    evaluations    designs that the optimiser may try
    sample_trials  trials for each design that the tolerance region is computed from
    fresh_trials   trials on which start and best are compared at the end
    margin         share by which the error may grow in the tolerance region of `sample`
    span           half the width of that region's box, as a share of each variable's range
    """

    variables: tuple[Variable, ...] = ()
    requirements: Requirements = field(default_factory=Requirements)
    objective: str = "across"
    fidelity: Fidelity = Fidelity.FRAME
    trials: int = 64
    evaluations: int = 120
    sample_trials: int = 160
    fresh_trials: int = 1000
    margin: float = 0.2
    span: float = 0.15

    def __post_init__(self) -> None:
        one_of(("across", "about"), objective=self.objective)
        whole(2, 10**6, trials=self.trials, fresh_trials=self.fresh_trials)
        whole(2, 10**6, sample_trials=self.sample_trials)
        whole(1, 10**6, evaluations=self.evaluations)
        positive(margin=self.margin)
        within(0.001, 0.5, span=self.span)
