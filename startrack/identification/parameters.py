"""Identification: tolerances of the camera model and thresholds of the match."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from startrack.core import (
    POSITIVE,
    Parameters,
    Range,
)

METHODS = ("triangles",)


@dataclass(frozen=True)
class Identification(Parameters):
    """Settings of the identification of spots, for calibrated cameras by default.

    The defaults are chosen by hand, for speed against success; experiments/identification.py and
    experiments/real_images.py show the success that they lead to, but do not vary them.

    Raises                 ValueError where a value lies outside its range.
    """

    focal_tolerance: Annotated[float, Range(0, 0.3),
        "relative error allowed to the focal length; 0 holds it, above 0 it is estimated with "
        "the attitude"] = 0.01  # fmt: skip
    match_radius: Annotated[float, POSITIVE,
        "pixel, largest distance between a spot and its star"] = 2.0  # fmt: skip
    max_false_probability: Annotated[float, Range(0, 1, above=True),
        "largest bound on the probability that chance makes an accepted match"] = 1e-5  # fmt: skip
    max_false_track: Annotated[float, Range(0, 1, above=True),
        "the same with a predicted attitude; larger, because the prediction has been confirmed "
        "before and two stars are weak evidence"] = 1e-3  # fmt: skip
    min_matches: Annotated[int, Range(4, 2**20), "fewest matched stars of an accepted match"] = 4
    pattern_spots: Annotated[int, Range(4, 40),
        "number of the brightest spots that form triangles first; the other spots of "
        "`verify_spots` follow"] = 24  # fmt: skip
    verify_spots: Annotated[int, Range(4, 2**20),
        "number of the brightest spots that verify a hypothesis"] = 40  # fmt: skip
    code_tolerance: Annotated[float, Range(0, 0.1),
        "error of a triangle's code beyond the noise of the centroids, from distortion that the "
        "camera model lacks"] = 0.003  # fmt: skip
    max_hypotheses: Annotated[int, Range(1, 2**30),
        "number of hypotheses after which the search ends without a match"] = 4000  # fmt: skip
    method: Annotated[str, Range(choices=METHODS, code="identifications"),
        "\"triangles\": codes of triangles, which other spots verify; or code of one's own, see "
        "docs/extensions.md. Of the keys above it, code follows min_matches and what it reads "
        "itself"] = "triangles"  # fmt: skip
