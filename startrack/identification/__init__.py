"""Spots into catalogue stars: Spots become Matches.

parameters   Identification: what the tracker believes of its camera, and how sure it wants to be.
sky          Directions enter; a grid that finds those around any direction leaves, for compiled
             code.
index_stars  Stars enter; those that the camera separates leave, with their rank in local
             brightness.
index        Stars enter; the codes of their triangles leave, sorted so that similar ones lie
             together.
cache        Stars and a field of view enter; their pattern index leaves, from a file where there
             is one.
seen         Spots and the believed camera enter; the spots in its image plane leave, for compiled
             code.
spot_grid    Spots enter; which of them lies near a place leaves, in the time of one look.
fit          Matched directions and points in the image plane enter; attitude and scale leave.
predict      An attitude enters; the stars that the image should hold, and where, leave.
agree        Spots and predicted stars enter; one-to-one matches leave, and the attitude that they
             give.
evidence     A match enters; the log-evidence for it leaves, by positions and by brightness.
verify       A hypothesis from three stars enters; how many spots it explains, and how well,
             leaves.
search       Triangles of spots enter, brightest first; the first hypothesis beyond doubt leaves.
identify     Spots, the believed camera and the catalogue enter; Matches leave.
blind        Spots of a camera of which nothing is known enter; Matches leave, with its field of
             view.
track        Spots and a predicted attitude enter; Matches leave.
"""

from startrack.identification.agree import refit
from startrack.identification.blind import identify_blind
from startrack.identification.cache import cache_folder, cached_index
from startrack.identification.identify import identify, identify_all
from startrack.identification.index import POINTS, PatternIndex, build_index, indexed_field
from startrack.identification.index_stars import merged
from startrack.identification.parameters import Identification
from startrack.identification.track import track

# Public; the other imports serve other rooms.
__all__ = [
    "Identification",
    "PatternIndex",
    "build_index",
    "cached_index",
    "identify",
    "identify_all",
    "identify_blind",
    "track",
]
