"""Star identification: Spots become Matches with catalogue stars.

parameters  Identification: tolerances of the camera and thresholds of the match, or user code.
grids       Grids that find directions within an angle, and spots near a position.
index       The pattern index: codes of triangles of stars, sorted into cells.
cache       The pattern index of a catalogue and a field of view, from a file if one exists.
seen        Spots in the image plane of the believed camera, and the stars expected in the image.
fit         Attitude and scale from matched directions and points in the image plane.
agree       One-to-one matches of spots and predicted stars, and the attitude that they give.
evidence    The log-evidence for a match, from positions and from brightness.
verify      Hypothesis -> its matches, and a bound on the probability of such a match by chance.
regrow      A sparse match that one false match may distort -> an attitude grown from its patches.
search      The first accepted hypothesis from triangles of spots, brightest first.
identify    Matches from spots, the believed camera and the catalogue.
blind       Spots of an unknown camera -> matches and field of view, by trying cameras.
lens_fit    Matches of one image -> its attitude with the distortion of the lens.
track       Matches from spots and a predicted attitude.
"""

from startrack.identification.agree import NARROWEST, REACH, Agreed, refit
from startrack.identification.blind import (
    WIDEST_PINHOLE,
    cameras,
    cameras_of,
    fisheye,
    identify_blind,
)
from startrack.identification.cache import PatternIndexes, cached_index
from startrack.identification.evidence import LOG_ATTITUDES, log_evidence
from startrack.identification.identify import identify
from startrack.identification.index import (
    POINTS,
    PatternIndex,
    build_index,
    indexed_field,
    local_rank,
    merged,
)
from startrack.identification.lens_fit import LensFit, fit_again, fit_frame, fit_lens
from startrack.identification.parameters import Identification, IdentificationInput
from startrack.identification.seen import LEAST_SIGMA, keep_brightest, see, usable
from startrack.identification.track import track
from startrack.identification.verify import log_evidence_of_match

# Public; the other imports serve other rooms.
__all__ = [
    "Identification",
    "IdentificationInput",
    "PatternIndexes",
    "build_index",
    "identify",
    "identify_blind",
    "track",
]
