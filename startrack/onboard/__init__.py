"""Flight software's data: a design becomes its guide-star catalogue and pattern index.

guide     Case -> its guide stars: in the band of the instrument, doubles and variables marked,
          thinned; and the triangles of them.
layout    Guide stars and triangles -> the bytes of a file, its C header and reader; and back.
compiled  The reader in C, compiled on this machine and called with the bytes of a file.

startrack_guide.h and startrack_guide.c are the reader in C99 that is written beside the file.
"""

from startrack.onboard.compiled import CompiledGuide, c_compiler
from startrack.onboard.guide import GuideSettings, guide_stars, read_variables
from startrack.onboard.layout import DOUBLE, VARIABLE, Guide, read_guide, write_guide

# Public; the other imports serve other rooms.
__all__ = [
    "CompiledGuide",
    "GuideSettings",
    "guide_stars",
    "read_guide",
    "read_variables",
    "write_guide",
]
