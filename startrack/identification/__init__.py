"""Spots into catalogue stars.

parameters  Identification: what the tracker believes, and how sure it wants to be
sky         SkyGrid: the stars around a direction, for compiled code
thin        how bright a star is among its neighbours, so that every field has its share
merge       stars too close for the camera become one
code        three directions -> a code of two numbers that neither rotation nor scale changes
index       Stars -> PatternIndex: the codes of the sky
seen        Spots as the believed camera sees them
predict     an attitude -> the stars that the image should hold
sieve       which spot lies near a place, in one look
pair        predicted stars and spots -> one-to-one matches
fit         matched directions -> attitude and scale
agree       matching and fitting in turns, until they agree
brightness  how much the brightness of the spots speaks for a match
evidence    how improbable it is that chance alone makes a match
verify      a hypothesis from three stars -> how many other spots it explains, and how well
search      triangles of spots -> the first hypothesis beyond doubt
gather      an attitude -> the matches of all spots
refit       matches -> the focal length that they give
identify    Spots, PatternIndex -> Matches, with nothing known of the attitude
follow      a predicted attitude -> the matches of the fewest spots that are beyond doubt
track       Spots, predicted attitude -> Matches
batch       many frames, one after the other
blind       the same with nothing known of the camera
calibrate   identified frames -> the camera that explains them
cache       an index that stays on disk from one run to the next
"""

from startrack.identification.batch import identify_all
from startrack.identification.blind import identify_blind
from startrack.identification.cache import cached_index
from startrack.identification.calibrate import Calibrated, Calibration, calibrate
from startrack.identification.identify import identify
from startrack.identification.index import PatternIndex, build_index
from startrack.identification.parameters import Identification
from startrack.identification.track import track

__all__ = [
    "Calibrated",
    "Calibration",
    "Identification",
    "PatternIndex",
    "build_index",
    "cached_index",
    "calibrate",
    "identify",
    "identify_all",
    "identify_blind",
    "track",
]
