"""Spots into catalogue stars, with nothing known of the attitude.

parameters  Identification: what the tracker believes, and how sure it wants to be
sky         SkyGrid: the stars around a direction, for compiled code
thin        how bright a star is among its neighbours, so that every field has its share
code        four directions -> a code of four numbers that neither rotation nor scale changes
index       Stars -> PatternIndex: the codes of the sky
chance      how probable it is that chance alone makes a match
fit         matched directions -> attitude and scale
verify      a hypothesis from four stars -> how many other spots it explains
search      patterns of spots -> the first hypothesis beyond doubt
identify    Spots, PatternIndex -> Matches
"""

from startrack.identification.identify import identify
from startrack.identification.index import PatternIndex, build_index
from startrack.identification.parameters import Identification

__all__ = ["Identification", "PatternIndex", "build_index", "identify"]
