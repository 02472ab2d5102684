"""Evaluations enter; how far trials are from the analytic budget, over the cube, leaves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.study.evaluate import Evaluation

Floats = NDArray[np.float64]

PRIOR = 0.3  # standard deviation of ln(measured / expected)
PRIOR_SLOPE = 1.0  # of its slope over the cube; 0.9 was found along the blur of the example
SCATTER = 0.5  # variance of ln(measured) from one trial; 1/4 for two axes and 1/2 for one, at least


@dataclass(frozen=True, eq=False)
class Correction:
    """ln(measured error / expected error), a plane over the cube, and how well it is known.

    The error of n trials is known to 1 / sqrt(4 n) at best, which is more than what neighbouring
    designs differ by. The budget has no noise, but is wrong by a factor that changes slowly;
    that, all designs that were tried tell together.

    middle      (d,) place
    terms       (d + 1,) the value there, and the slope
    covariance  (d + 1, d + 1) of these
    """

    middle: Floats
    terms: Floats
    covariance: Floats

    def __call__(self, place: Floats) -> float:
        """At a place (d,)."""
        return float(self.terms @ np.append(1.0, place - self.middle))

    def doubt(self, one: Floats, other: Floats) -> float:
        """Standard error of the difference between two places."""
        apart = np.append(0.0, one - other)
        return math.sqrt(float(apart @ self.covariance @ apart))


def correct(tried: Sequence[Evaluation], middle: Floats, reach: float) -> Correction:
    """The plane through the designs that were tried within `reach` of a place along each axis.

    Least squares, each design with the weight of its trials, with Gaussian priors on the value
    and the slopes, so that what few designs leave open stays near zero.
    """
    near = [
        one
        for one in tried
        if one.error > 0
        and one.expected > 0
        and np.abs(np.array(one.place) - middle).max() <= reach
    ]
    terms = np.array([[1.0, *(np.array(one.place) - middle)] for one in near])
    terms = terms.reshape(-1, len(middle) + 1)
    told = np.array([math.log(one.error / one.expected) for one in near])
    weight = np.array([one.trials / SCATTER for one in near])
    prior = np.full(len(middle) + 1, PRIOR_SLOPE)
    prior[0] = PRIOR
    normal = (terms.T * weight) @ terms + np.diag(prior**-2.0)
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    return Correction(middle, covariance @ (terms.T @ (weight * told)), covariance)
