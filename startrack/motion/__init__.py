"""How the line of sight moves during an exposure.

parameters     Motion: rates, tones and broadband jitter of the platform.
extension_jitter  Random numbers -> lines of jitter, by code that is not part of startrack.
realisation    Motion -> MotionRealisation: how the camera turns in one trial, at any time.
line_of_sight  Motion -> LineOfSight, sampled at as many points as the smear of a star needs.
stability      Drift and blur: of one line of sight, and their expectation over all trials.
transfer       Motion within an exposure -> its PSF, its transfer function and its MTF at Nyquist.
"""

from startrack.motion.extension_jitter import Jitter, JitterInput
from startrack.motion.line_of_sight import sample_jitter, slew, trace
from startrack.motion.parameters import Broadband, Motion, Tone
from startrack.motion.realisation import MotionRealisation, realise_motion
from startrack.motion.stability import Stability, blur, jitter_rms, stability
from startrack.motion.transfer import density, image_path, nyquist_mtf, transfer

# Public; the other imports serve other rooms.
__all__ = [
    "Broadband",
    "Jitter",
    "JitterInput",
    "Motion",
    "MotionRealisation",
    "Stability",
    "Tone",
    "blur",
    "density",
    "image_path",
    "jitter_rms",
    "nyquist_mtf",
    "realise_motion",
    "sample_jitter",
    "slew",
    "stability",
    "trace",
    "transfer",
]
