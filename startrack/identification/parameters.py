"""Identification: what the tracker believes of its camera, and how sure it wants to be."""

from __future__ import annotations

from dataclasses import dataclass

from startrack.core import non_negative, positive, whole, within


@dataclass(frozen=True)
class Identification:
    """How spots are told apart. The defaults serve calibrated cameras and real skies.

    focal_tolerance        relative, how far the focal length may lie from the camera's; 0 keeps
                           it as it is, anything else lets it be refined
    match_radius           pixel, how far a spot may lie from the star that it is taken for
    max_false_probability  a match that chance makes more often than this is refused
    max_false_track        the same where the attitude is predicted: a prediction that was right
                           so far deserves trust, and two stars can hardly outweigh chance
    min_matches            a match of fewer stars is refused, however improbable
    pattern_spots          the brightest so many spots form triangles, and only then those that vote
    verify_spots           the brightest so many spots vote on a hypothesis
    code_tolerance         1, error of a pattern's code beyond the noise of the centroids: what
                           distortion the camera model does not know does to it
    max_hypotheses         after so many hypotheses the sky counts as unsolved
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

    def __post_init__(self) -> None:
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
