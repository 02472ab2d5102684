"""Motion of the line of sight during an exposure.

parameters     Motion: rates, tones and broadband jitter of the platform.
realisation    Motion -> MotionRealisation: rotation of the camera in one trial, at any time.
line_of_sight  Motion -> LineOfSight of an exposure, its drift, blur and transfer function.
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
