"""Attitudes of two heads in time -> their relative alignment, and how it drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Refused


@dataclass(frozen=True, eq=False)
class RelativeAlignment:
    """Alignment of a second head against a first, as a linear model of what it depends on.

        rotation vector = sum_k features_k coefficient_k,   about the body's axes

    coefficient  (k, 3) radian per unit of each feature
    covariance   (k, k) of the coefficients about each axis, over `noise`
    noise        (3, 3) radian^2, of what the model leaves of a single pair of attitudes
    """

    coefficient: Floats
    covariance: Floats
    noise: Floats

    def __call__(self, features: Floats) -> tuple[Floats, Floats]:
        """Rotation vectors (n, 3) in radian at (n, k) features, and their covariance (n, 3, 3)."""
        spread = np.einsum("nk,kj,nj->n", features, self.covariance, features)
        return features @ self.coefficient, spread[:, None, None] * self.noise

    def corrected(self, second: Rotation, features: Floats) -> Rotation:
        """Attitudes (n,) of the second head as the first would see them."""
        return Rotation.from_rotvec(-self(features)[0]) * second


def relative_alignment(first: Rotation, second: Rotation, features: Floats) -> RelativeAlignment:
    """Fit how two heads differ, by least squares over simultaneous attitudes.

    The part of a drift that both heads share is not seen, and stays in the fused attitude.
    Features such as a temperature, its change, or sine and cosine of the orbit's phase describe a
    thermo-elastic drift; a column of ones is its bias.

    first, second  (n,) icrs_to_body by each head, with its assumed mounting
    features       (n, k), n > k
    Raises         ValueError where there are too few attitudes, or features that depend on each
                   other.
    Accuracy       model: rotations of arcseconds, whose noise does not depend on time; what the
                   features do not describe counts as white noise.
    """
    features = np.atleast_2d(np.asarray(features, float))
    count, parts = features.shape
    if len(first) != count or len(second) != count or count <= parts:
        raise Refused(
            f"features must have a row for each of the attitudes, more than their {parts} columns, "
            f"got {count} for {len(first)} and {len(second)} attitudes"
        )
    scale = np.sqrt((features**2).mean(axis=0))
    if (scale == 0).any() or np.linalg.cond(features / np.where(scale, scale, 1)) > 1e8:
        raise Refused("features must not depend on each other, nor be zero")
    apart = (second * first.inv()).as_rotvec()
    coefficient = np.linalg.lstsq(features / scale, apart, rcond=None)[0] / scale[:, None]
    rest = apart - features @ coefficient
    noise = rest.T @ rest / (count - parts)
    inverse = np.linalg.inv((features / scale).T @ (features / scale))
    return RelativeAlignment(coefficient, inverse / np.outer(scale, scale), noise)
