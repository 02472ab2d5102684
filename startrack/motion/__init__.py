"""How the line of sight moves in an exposure.

parameters  Motion: rates, tones and broadband jitter of the platform
spectrum    a one-sided power spectral density between the points of its table
turn        Motion -> Turn: what the camera does in one trial, at any time
quadrature  points and weights over the exposure
shake       Motion -> Path: as many points as the smear needs
transfer    Path -> where a star's image goes, its transfer function, the MTF at Nyquist
density     the time that an image spends in each cell of a grid
stability   drift and blur of a path, and what to expect of a motion (MPE, RPE)
"""

from startrack.motion.density import density
from startrack.motion.parameters import Broadband, Motion, Tone
from startrack.motion.shake import shake, slew, trace
from startrack.motion.stability import Stability, blur, stability, wander
from startrack.motion.transfer import image_path, nyquist_mtf, transfer
from startrack.motion.turn import Turn, turn

__all__ = [
    "Broadband",
    "Motion",
    "Stability",
    "Tone",
    "Turn",
    "blur",
    "density",
    "image_path",
    "nyquist_mtf",
    "shake",
    "slew",
    "stability",
    "trace",
    "transfer",
    "turn",
    "wander",
]
