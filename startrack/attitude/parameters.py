"""SolverSettings: errors assumed of centroids, and when a star is left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from startrack.core import (
    NON_NEGATIVE,
    POSITIVE,
    Parameters,
    Range,
)

# Pixel per axis, typical of calibrated cameras. Chosen by hand: a larger one gives all stars nearly
# the same weight, a smaller one states too small a covariance for bright stars.
UNKNOWN_FLOOR = 0.015


METHODS = ("least squares",)


@dataclass(frozen=True)
class SolverSettings(Parameters):
    """How matched stars are weighted, and when one is left out.

    Raises  ValueError where the floor is negative or the gate is not positive.
    """

    centroid_floor: Annotated[float | None, NON_NEGATIVE,
        "pixel, systematic error per axis that every centroid has beside its noise: sampling by "
        "pixels, their unequal response, light of other stars; None: the prediction of the "
        "design for each star, or 0.015 where there is no design"] = None  # fmt: skip
    gate: Annotated[float, POSITIVE,
        "sigma, normalised residual beyond which a star is left out as a false match, a double "
        "star or a hot pixel; scaled with the residuals where these are larger than the noise "
        "explains. Chosen by hand: a smaller one loses stars, a larger one keeps outliers"
    ] = 5.0  # fmt: skip
    sift: Annotated[bool,
        "first take the largest set of stars that agree on one attitude within the gate, "
        "however small; for matches that were not verified together"] = False  # fmt: skip
    method: Annotated[str, Range(choices=METHODS, code="attitudes"),
        "\"least squares\": by the residuals in the image plane; or code of one's own, see "
        "docs/extensions.md, which then also handles outliers: gate and sift are not used"
    ] = "least squares"  # fmt: skip
