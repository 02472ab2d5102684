"""Data for flight software: guide-star catalogue and pattern index of a design.

guide     Case -> guide stars, with magnitudes in the instrument's band, marked doubles and
          variables, thinned; and their triangles.
layout    Guide stars and triangles <-> the bytes of a file; its C header and reader.
compiled  The reader in C, compiled on this machine and called with the bytes of a file.

startrack_guide.h and startrack_guide.c are the reader in C99, written beside the file.
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
