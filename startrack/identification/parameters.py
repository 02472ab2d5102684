"""Identification: tolerances of the camera model and thresholds of the match."""

from __future__ import annotations

from dataclasses import dataclass

from startrack.core import (
    code_field,
    full_name,
    non_negative,
    one_of_or_code,
    positive,
    whole,
    within,
)

METHODS = ("triangles",)


@dataclass(frozen=True)
class Identification:
    """Settings of the identification of spots, for calibrated cameras by default.

    The defaults are chosen by hand, for speed against success; experiments/identification.py and
    experiments/real_images.py show the success that they lead to, but do not vary them.

    focal_tolerance        relative error allowed to the focal length; 0 holds it, above 0 it is
                           estimated with the attitude
    match_radius           pixel, largest distance between a spot and its star
    max_false_probability  largest bound on the probability that chance makes an accepted match
    max_false_track        the same with a predicted attitude; larger, because the prediction has
                           been confirmed before and two stars are weak evidence
    min_matches            fewest matched stars of an accepted match
    pattern_spots          number of the brightest spots that form triangles first; the other spots
                           of `verify_spots` follow
    verify_spots           number of the brightest spots that verify a hypothesis
    code_tolerance         1, error of a triangle's code beyond the noise of the centroids, from
                           distortion that the camera model lacks
    max_hypotheses         number of hypotheses after which the search ends without a match
    method                 "triangles": codes of triangles, which other spots verify; or code of
                           one's own, see docs/extensions.md. Of the keys above it, code follows
                           min_matches and what it reads itself
    Raises                 ValueError where a value lies outside its range.
    """

    focal_tolerance: float = 0.01
    match_radius: float = 2.0
    max_false_probability: float = 1e-5
    max_false_track: float = 1e-3
    min_matches: int = 4
    pattern_spots: int = 24
    verify_spots: int = 40
    code_tolerance: float = 0.003
    max_hypotheses: int = 4000
    method: str = code_field("identifications", "triangles")

    def __post_init__(self) -> None:
        method = full_name("identifications", METHODS, self.method)
        object.__setattr__(self, "method", method)
        one_of_or_code(METHODS, method=self.method)
        within(0, 0.3, focal_tolerance=self.focal_tolerance)
        positive(match_radius=self.match_radius, max_false_probability=self.max_false_probability)
        within(0, 1, max_false_probability=self.max_false_probability)
        positive(max_false_track=self.max_false_track)
        within(0, 1, max_false_track=self.max_false_track)
        whole(4, 2**20, min_matches=self.min_matches, verify_spots=self.verify_spots)
        whole(4, 40, pattern_spots=self.pattern_spots)
        whole(1, 2**30, max_hypotheses=self.max_hypotheses)
        non_negative(code_tolerance=self.code_tolerance)
        within(0, 0.1, code_tolerance=self.code_tolerance)
