"""A place in a box enters; how good its design is leaves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.error import Summary, summarise
from startrack.study.bench import Bench
from startrack.study.box import Box
from startrack.study.campaign import Campaign
from startrack.study.objective import Objective
from startrack.study.requirements import Requirements
from startrack.units import arcsec

PENALTY = 10.0  # ln(error) that a margin missed by its full size costs
LOST = 20.0  # ln(arcsec) of a design that no trial solves

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Evaluation:
    """One design that was tried.

    place    in the unit cube
    values   of the variables, SI
    error    radian, the objective; NaN where no trial was solved
    stated   radian, the objective by what the tracker states of the same trials; NaN likewise
    score    what is minimised: ln(stated / arcsec), set right by what is known of the tracker's
             honesty, plus penalties
    margins  of the requirements, availability with them; below 0, not met
    summary  of the trials, None where the design cannot be tried
    note     why not, or empty
    """

    place: tuple[float, ...]
    values: dict[str, float]
    error: float
    stated: float
    score: float
    margins: dict[str, float]
    summary: Summary | None
    note: str

    @property
    def feasible(self) -> bool:
        """Whether every requirement is met."""
        return self.summary is not None and all(m >= 0 for m in self.margins.values())

    @property
    def trials(self) -> int:
        """How many it was tried with."""
        return self.summary.trials if self.summary else 0


def evaluate(
    box: Box,
    campaign: Campaign,
    place: Floats,
    bench: Bench,
    trials: int | None = None,
    honesty: Callable[[Floats], float] | None = None,
) -> Evaluation:
    """Score a design on the bench's trials: the same skies and streams for every design.

        score = ln(stated / arcsec) + honesty(place) + PENALTY sum(max(0, -margin))

    The expectation of an error, given the stars that were seen, is less noisy than the error
    (Rao-Blackwell); the tracker states it, and `honesty` says by what factor it is wrong. An L1 penalty has the same least place as the constrained problem where PENALTY exceeds the
    slope of ln(error) along the margin (Fletcher 1987, Practical Methods of Optimization, 14.3).

    trials   None for the campaign's first number
    honesty  ln(error / stated) at a place, None where the tracker's word is taken
    Returns  an evaluation; a design that cannot be built or rendered has a note in it.
    """
    place = np.clip(place, 0, 1)
    values = box.values(place)
    try:
        case = box.design(place)
        margins = campaign.requirements.margins(case)
        outcomes = bench.run(case, trials or campaign.trials, campaign.fidelity)
    except ValueError as reason:  # a design that cannot be built is a bad one, not the end
        refused = LOST + PENALTY
        return Evaluation(tuple(place), values, math.nan, math.nan, refused, {}, None, str(reason))
    summary = summarise(outcomes)
    margins |= measured(campaign.requirements, summary)
    objective = Objective.read(campaign.objective)
    error = float(objective.of(objective.squares(outcomes)))
    stated = objective.stated(objective.variances(outcomes))
    score = math.log(stated / arcsec) if stated > 0 else LOST
    score += honesty(place) if honesty else 0.0
    score += PENALTY * missed(margins)
    return Evaluation(tuple(place), values, error, stated, score, margins, summary, "")


def measured(requirements: Requirements, summary: Summary) -> dict[str, float]:
    """The margins that take trials."""
    return {
        "availability": summary.availability.value - requirements.min_availability,
        "false attitudes": -summary.false.value,
    }


def missed(margins: dict[str, float]) -> float:
    """The sum of what the margins are short of."""
    return sum(max(0.0, -margin) for margin in margins.values())
