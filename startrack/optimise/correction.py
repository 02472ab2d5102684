"""Trials of designs -> errors of the forecasts of other designs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from startrack.core import Floats
from startrack.optimise.evaluate import Evaluation
from startrack.optimise.limit import SCATTER


@dataclass(frozen=True, eq=False)
class Correction:
    """ln(measured error / expected error) as a linear function over the cube, and its covariance.

    The relative standard error of n trials is at best 1 / sqrt(4 n), which is more than the
    difference between neighbouring designs. The budget has no noise, but it has an error that
    changes slowly over the cube. The trials of all designs estimate this error together.

    middle      (d,) unit-cube coordinates
    terms       (d + 1,) the value at the middle, and the slope
    covariance  (d + 1, d + 1) of the terms
    """

    middle: Floats
    terms: Floats
    covariance: Floats

    def __call__(self, coordinates: Floats) -> float:
        """The correction at unit-cube coordinates (d,)."""
        return float(self.terms @ np.append(1.0, coordinates - self.middle))

    @property
    def slope(self) -> Floats:
        """Slope (d,) of the correction, per range of each variable."""
        return self.terms[1:]

    def standard_error(self, point: Floats, other: Floats) -> float:
        """Standard error of the difference of the correction between two designs."""
        apart = np.append(0.0, point - other)
        return math.sqrt(float(apart @ self.covariance @ apart))


# Standard deviations of ln(measured / expected) and of its slope over the cube. Chosen by hand:
# with a wider prior, the noise of few designs changes the correction more.
PRIOR = 0.3
PRIOR_SLOPE = 0.1


def fit_correction(tried: Sequence[Evaluation], middle: Floats, radius: float) -> Correction:
    """Fit the correction to the designs within `radius` of the middle along each axis.

    It is a least-squares fit, weighted by the numbers of trials. Gaussian priors on the value and
    the slopes keep terms near zero that few designs constrain. A cost needs no correction.
    """
    if any(math.isfinite(evaluation.cost) for evaluation in tried):
        none = np.zeros(len(middle) + 1)
        return Correction(middle, none, np.outer(none, none))
    near = [
        evaluation
        for evaluation in tried
        if evaluation.error > 0
        and evaluation.expected > 0
        and np.abs(np.array(evaluation.coordinates) - middle).max() <= radius
    ]
    terms = np.array([[1.0, *(np.array(evaluation.coordinates) - middle)] for evaluation in near])
    terms = terms.reshape(-1, len(middle) + 1)
    ratio = np.array([math.log(evaluation.error / evaluation.expected) for evaluation in near])
    weight = np.array([evaluation.trials / SCATTER for evaluation in near])
    prior = np.full(len(middle) + 1, PRIOR_SLOPE)
    prior[0] = PRIOR
    normal = (terms.T * weight) @ terms + np.diag(prior**-2.0)
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    return Correction(middle, covariance @ (terms.T @ (weight * ratio)), covariance)
