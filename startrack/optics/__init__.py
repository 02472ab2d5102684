"""How a point is blurred: the optics become a table of pixel-integrated responses.

parameters  Optics: focal length, aperture, blur, transmission
transfer    transfer functions of a circular pupil, of a Gaussian blur and of the pixel
focus       Optics -> Psf
"""

from startrack.optics.focus import focus, pixel_response
from startrack.optics.parameters import Optics
from startrack.optics.transfer import blur_transfer, pixel_transfer, pupil_transfer

__all__ = [
    "Optics",
    "blur_transfer",
    "focus",
    "pixel_response",
    "pixel_transfer",
    "pupil_transfer",
]
