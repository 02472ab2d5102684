"""Numbers into spots.

parameters  Detection: what counts as a spot
dark        Frame, dark frame -> Frame without the fixed pattern
pixels      Frame -> Pixels: float32 without holes
robust      background and noise of pixels that stars may be among
background  filtered image -> the level that a spot must exceed
find        Pixels -> Candidates: peaks that look like stars
centroid    Candidates -> Spots
detect      Frame -> Spots
"""

from startrack.detection.dark import subtract_dark
from startrack.detection.detect import detect
from startrack.detection.parameters import Detection

__all__ = ["Detection", "detect", "subtract_dark"]
