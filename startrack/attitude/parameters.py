"""Attitude: how far the tracker trusts its centroids."""

from __future__ import annotations

from dataclasses import dataclass

from startrack.core import non_negative, positive

UNKNOWN_FLOOR = 0.015  # pixel, what calibrated cameras commonly come to


@dataclass(frozen=True)
class SolverSettings:
    """How matched stars are weighted, and when one is left out.

    centroid_floor  pixel, error per axis that every centroid has beside its noise: what the
                    pixels average away, their unequal response, the light of other stars; None:
                    star by star what the design leads to expect, and UNKNOWN_FLOOR where there is
                    no design
    gate            sigma, normalised residual beyond which a star is left out as a mis-match, a
                    double star or a hot pixel; scaled with the residuals where these are larger
                    than the noise explains
    sift            first take the largest set of stars that agree on one attitude within the gate,
                    however many do not; for matches that were not verified together
    """

    centroid_floor: float | None = None
    gate: float = 5.0
    sift: bool = False

    def __post_init__(self) -> None:
        if self.centroid_floor is not None:
            non_negative(centroid_floor=self.centroid_floor)
        positive(gate=self.gate)
