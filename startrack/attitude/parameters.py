"""SolverSettings: errors assumed of centroids, and when a star is left out."""

from __future__ import annotations

from dataclasses import dataclass

from startrack.core import code_field, full_name, non_negative, one_of_or_code, positive

# Pixel per axis, typical of calibrated cameras. Chosen by hand: a larger one gives all stars nearly
# the same weight, a smaller one states too small a covariance for bright stars.
UNKNOWN_FLOOR = 0.015


METHODS = ("least squares",)


@dataclass(frozen=True)
class SolverSettings:
    """How matched stars are weighted, and when one is left out.

    centroid_floor  pixel, systematic error per axis that every centroid has beside its noise:
                    sampling by pixels, their unequal response, light of other stars; None: the
                    prediction of the design for each star, or 0.015 where there is no design
    gate            sigma, normalised residual beyond which a star is left out as a false match, a
                    double star or a hot pixel; scaled with the residuals where these are larger
                    than the noise explains. Chosen by hand: a smaller one loses stars, a larger
                    one keeps outliers
    sift            first take the largest set of stars that agree on one attitude within the gate,
                    however small; for matches that were not verified together
    method          "least squares": by the residuals in the image plane; or code of one's own, see
                    docs/extensions.md, which then also handles outliers: gate and sift are not used
    Raises          ValueError where the floor is negative or the gate is not positive.
    """

    centroid_floor: float | None = None
    gate: float = 5.0
    sift: bool = False
    method: str = code_field("attitudes", "least squares")

    def __post_init__(self) -> None:
        if self.centroid_floor is not None:
            non_negative(centroid_floor=self.centroid_floor)
        positive(gate=self.gate)
        object.__setattr__(self, "method", full_name("attitudes", METHODS, self.method))
        one_of_or_code(METHODS, method=self.method)
