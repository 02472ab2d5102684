"""Evaluations enter; how far errors are from what the tracker states of them, by place, leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.study.evaluate import Evaluation

Floats = NDArray[np.float64]

PRIOR = 0.5  # standard deviation of ln(measured / stated), and of its slope over the cube
SCATTER = 0.5  # variance of ln(measured / stated) of one trial; 1/4 and 1/2 for two and one axes


@dataclass(frozen=True, eq=False)
class Honesty:
    """ln(measured error / stated error), a plane over the cube.

    A measured error is a draw, so that its mean over n trials is known to 1 / sqrt(4 n). What the
    tracker states of the same trials hardly is, and smooth over designs; it is wrong by a factor
    that changes slowly, which all designs that were tried tell together.

    middle  (d,) place
    value   1, there
    slope   (d,)
    """

    middle: Floats
    value: float
    slope: Floats

    def __call__(self, place: Floats) -> float:
        """At a place (d,)."""
        return self.value + float(self.slope @ (place - self.middle))


def fit_honesty(tried: Sequence[Evaluation], middle: Floats, reach: float) -> Honesty:
    """The plane through the designs that were tried within `reach` of a place along each axis.

    Least squares, each design with the weight of its trials, with Gaussian priors on the value
    and the slopes, so that what few designs leave open stays near zero.
    """
    near = [
        one
        for one in tried
        if one.error > 0 and one.stated > 0 and np.abs(np.array(one.place) - middle).max() <= reach
    ]
    terms = np.array([[1.0, *(np.array(one.place) - middle)] for one in near])
    terms = terms.reshape(-1, len(middle) + 1)
    told = np.array([np.log(one.error / one.stated) for one in near])
    weight = np.array([one.trials / SCATTER for one in near])
    normal = (terms.T * weight) @ terms + np.eye(len(middle) + 1) / PRIOR**2
    solution = np.linalg.solve(normal, terms.T @ (weight * told))
    return Honesty(middle, float(solution[0]), np.asarray(solution[1:], np.float64))
