"""How a point is blurred: the optics become a table of pixel-integrated responses.

parameters  Optics: focal length, aperture, aberrations, blur, transmission, model
pupil       the open area, sampled for quadrature
zernike     wavefront errors by Noll's index
airy        clear circle, in closed form
gaussian    eqs. (12) and (13)
fraunhofer  any pupil, by a matrix Fourier transform
fresnel     any plane near the image, by a chirp transform
kirchhoff   eqs. (7) and (9) by adaptive quadrature: the reference
wavefront   the pupil as each model takes it
validity    how far Fresnel holds: eq. (11), and a criterion that is stable
choose      the cheapest model for a tolerance, and why
band        many wavelengths -> a few
transfer    transfer functions of a circular pupil, of a Gaussian blur and of the pixel
focus       Optics -> Psf
over_field  Optics -> Psf at places in the field
baffle      stray light of Sun, Moon and Earth
quality     modulation transfer, encircled and ensquared energy, widths
"""

from startrack.optics.baffle import Baffle, veil
from startrack.optics.choose import Choice, choose
from startrack.optics.focus import focus, pixel_response
from startrack.optics.over_field import at_field, over_field
from startrack.optics.parameters import Optics
from startrack.optics.pupil import Pupil, Segment
from startrack.optics.quality import POINT, Quality, encircled, modulation, quality
from startrack.optics.transfer import blur_transfer, pixel_transfer, pupil_transfer
from startrack.optics.zernike import Aberration

__all__ = [
    "POINT",
    "Aberration",
    "Baffle",
    "Choice",
    "Optics",
    "Pupil",
    "Quality",
    "Segment",
    "at_field",
    "blur_transfer",
    "choose",
    "encircled",
    "focus",
    "modulation",
    "over_field",
    "pixel_response",
    "pixel_transfer",
    "pupil_transfer",
    "quality",
    "veil",
]
