"""Spots into catalogue stars: Spots become Matches.

parameters   Identification: tolerances of the camera model and thresholds of the match.
sky          A grid of directions that finds those within an angle of any direction.
index_stars  Stars merged where the camera cannot separate them, and their rank in brightness.
index        The pattern index: codes of triangles of stars, sorted into cells.
cache        The pattern index of a catalogue and a field of view, from a file where there is one.
seen         Spots in the image plane of the believed camera.
spot_grid    A grid of spots that finds the spot near a position with one array access.
fit          Attitude and scale from matched directions and points in the image plane.
predict      The stars that the image should hold at an attitude, and their positions.
agree        One-to-one matches of spots and predicted stars, and the attitude that they give.
evidence     The log-evidence for a match, from positions and from brightness.
verify       How many spots a hypothesis explains, and the bound on chance.
search       The first accepted hypothesis from triangles of spots, brightest first.
identify     Matches from spots, the believed camera and the catalogue.
extension_method  Spots, the believed camera and the catalogue -> Matches, by code that is not
             part of startrack.
blind        Matches and field of view from the spots of an unknown camera.
lens_fit     Matches of one image of an unknown lens -> its distortion, and more matches.
track        Matches from spots and a predicted attitude.
"""

from startrack.identification.agree import refit
from startrack.identification.blind import identify_blind
from startrack.identification.cache import PatternIndexes, cached_index
from startrack.identification.extension_method import IdentificationInput, IdentificationMethod
from startrack.identification.identify import identify, identify_all
from startrack.identification.index import (
    POINTS,
    PatternIndex,
    build_index,
    indexed_field,
)
from startrack.identification.index_stars import local_rank, merged
from startrack.identification.lens_fit import LensFit, fit_lens
from startrack.identification.parameters import Identification
from startrack.identification.track import track

# Public; the other imports serve other rooms.
__all__ = [
    "Identification",
    "IdentificationInput",
    "IdentificationMethod",
    "LensFit",
    "PatternIndex",
    "PatternIndexes",
    "build_index",
    "cached_index",
    "fit_lens",
    "identify",
    "identify_all",
    "identify_blind",
    "track",
]
