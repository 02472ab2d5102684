"""A limit that trials decide -> the forecast margin that a design needs to meet it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from startrack.core import Floats
from startrack.optimise.gaussian_process import matern

# Largest amount by which a missed limit counts in a score; beyond it only ln(error) determines the
# search. Chosen by hand: an error of ten times the limit.
MOST_MISSED = 9.0
SCATTER = 0.5  # variance of ln(measured) from one trial: at least 1/4 for two axes, 1/2 for one
# Standard deviations of ln(true load / forecast load) of a margin; True: for probabilities. All
# chosen by hand.
COMMON = {False: 0.3, True: 0.5}  # of all designs together
# Of single designs, with the fraction of the cube over which it changes. For probabilities it also
# changes over a shorter distance: where attitudes begin to be lost, their number grows tenfold
# within a twentieth of a range, and the forecast of this place has a small error.
OWN = {False: ((0.1, 0.3),), True: ((1.3, 0.3), (1.5, 0.05))}
MODEL = {False: 0.02, True: 0.1}  # standard deviation that no number of trials removes
BASE = 0.02  # fraction of the allowed loss that may occur in addition to any forecast
STEPS = 100  # most steps of the fit
POWER = 0.95  # probability that trials confirm a design that just reaches `Limit.shown`


class Evidence(NamedTuple):
    """Result of a design's trials for a margin.

    point     (d,) unit-cube coordinates
    forecast  margin by the budget
    measured  the margin as the trials found it, not a bound
    trials    number of them
    """

    point: Floats
    forecast: float
    measured: float
    trials: int


@dataclass(frozen=True, eq=False)
class Limit:
    """A margin that trials decide, and the error of its forecasts by these trials.

    The load is the error over its limit, or the fraction of trials without a correct attitude:

        load = room - margin,   true load = (forecast load + base) exp(g(x))

    g is a Gaussian process over the cube, fitted to the results of some designs' trials. If the
    load of a design is at most `shown`, which is below `room`, fresh trials confirm with a
    probability of POWER that it meets the limit.

    room    allowed load
    shown   largest load that fresh trials can confirm
    chance  whether the load is a fraction of trials (a probability)
    points  (n, d) designs that were tried
    weight  (n,) weights of these designs in g
    """

    room: float
    shown: float
    chance: bool
    points: Floats | None = None
    weight: Floats | None = None

    @classmethod
    def of_chance(cls, least: float, trials: int, tail: float) -> Limit:
        """Limit that at least a fraction of the trials has a correct attitude.

        trials  largest number of fresh trials
        tail    probability that the bound of Clopper and Pearson does not hold
        """
        room = 1 - least
        most_lost = int(scipy.stats.binom.ppf(tail, trials, room)) - 1
        if most_lost < 0:  # no result of these trials would confirm it
            return cls(room, room, chance=True)
        return cls(room, float(scipy.special.bdtri(most_lost, trials, POWER)), chance=True)

    @classmethod
    def of_error(cls, fraction: float | None, trials: int, tail: float) -> Limit:
        """Limit on the ratio of an error to the limit of the requirement.

        fraction  of trials whose error does not exceed the limit, None for an rms
        Accuracy  model: the standard error is computed for normal errors along two axes.
        """
        scatter = SCATTER
        if fraction is not None:  # standard error of the order statistic of a Rayleigh distribution
            scatter = fraction / ((1 - fraction) * 4 * math.log(1 - fraction) ** 2)
        sigmas = scipy.special.ndtri(1 - tail) + scipy.special.ndtri(POWER)
        return cls(1.0, math.exp(-sigmas * math.sqrt(scatter / trials)), chance=False)

    def corrected(self, point: Floats, margin: float) -> float:
        """The margin for a design's forecast that fresh trials can confirm."""
        load = self._load(margin) * math.exp(self._log_ratio(point)) * self.room / self.shown
        return self.room - min(load, self._most)

    def fitted(self, evidence: Sequence[Evidence]) -> Limit:
        """The limit with its correction of forecasts fitted to trials.

        Counts of lost trials have Poisson distributions, errors normal ones. The fit is the mode of
        the posterior of g, by Newton's method (Rasmussen and Williams 2006, Gaussian Processes for
        Machine Learning, 3.4).
        """
        some = [design for design in evidence if self.room - design.measured > 0 or self.chance]
        if not some:
            return replace(self, points=None, weight=None)
        points = np.array([design.point for design in some])
        trials = np.array([design.trials for design in some])
        forecast = np.array([self._load(design.forecast) for design in some])
        measured = np.array([min(self.room - design.measured, self._most) for design in some])
        prior, model = self._alike(points, points), MODEL[self.chance] ** 2
        ratio, weight = np.zeros(len(some)), np.zeros(len(some))
        for _ in range(STEPS):
            if self.chance:
                expected = trials * forecast * np.exp(ratio)
                target, noise = ratio + trials * measured / expected - 1, 1 / expected
            else:
                target, noise = np.log(measured / forecast), SCATTER / trials
            weight = np.linalg.solve(prior + np.diag(noise + model), target)
            step = np.clip(prior @ weight - ratio, -1, 1)
            ratio = ratio + step
            if np.abs(step).max() < 1e-6:
                break
        return replace(self, points=points, weight=weight)

    @property
    def _most(self) -> float:
        return 1.0 if self.chance else 1 + MOST_MISSED

    def _load(self, margin: float) -> float:
        return max(self.room - margin, 0.0) + (BASE * self.room if self.chance else 1e-9)

    def _log_ratio(self, point: Floats) -> float:
        if self.points is None or self.weight is None:
            return 0.0
        return float(self._alike(point[None], self.points)[0] @ self.weight)

    def _alike(self, points: Floats, others: Floats) -> Floats:
        apart = np.linalg.norm(points[:, None] - others[None], axis=-1)
        own = sum(size**2 * matern(apart / length) for size, length in OWN[self.chance])
        return np.asarray(COMMON[self.chance] ** 2 + own)
