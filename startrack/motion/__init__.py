"""How the line of sight moves in an exposure.

parameters  Motion: the rates of the platform
slew        Motion -> Path
"""

from startrack.motion.parameters import Motion
from startrack.motion.slew import slew

__all__ = ["Motion", "slew"]
