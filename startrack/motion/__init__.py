"""How the line of sight moves during an exposure.

parameters     Motion: rates, tones and broadband jitter of the platform.
realisation    Motion -> MotionRealisation: how the camera turns in one trial, at any time.
line_of_sight  Motion -> LineOfSight of an exposure, the drift and blur that it makes, its transfer
               function.
"""

from startrack.motion.line_of_sight import (
    blur,
    exposure_mean_rms,
    image_path,
    jitter_rms,
    sample_jitter,
    slew,
    stability,
    trace,
    transfer,
)
from startrack.motion.parameters import Broadband, Motion, Tone
from startrack.motion.realisation import JitterInput, MotionRealisation, realise_motion

# Public; the other imports serve other rooms.
__all__ = ["Broadband", "JitterInput", "Motion", "Tone", "realise_motion"]
