"""How a point is blurred: Optics become a Psf.

parameters  Optics: focal length, aperture, aberrations, blur, transmission, and which PSF stands
            for it.
pupil       The shape of the aperture: clear, obscured, crossed by a spider, segmented or sparse.
zernike     Zernike polynomials by Noll's index: the shapes of wavefront errors.
wavefront   Optics -> the complex pupil of a model: what each model takes the wave in the exit
            pupil for.
kirchhoff   The Kirchhoff integral over a thin lens, without a paraxial shortcut: the reference of
            the room.
fresnel     Fresnel diffraction of any pupil in any plane near the image, by a fast chirp
            transform.
fraunhofer  Fraunhofer diffraction of any pupil by a matrix Fourier transform, folded by symmetry.
airy        The closed forms of a clear circular pupil: irradiance, field and encircled energy.
gaussian    The Gaussian PSF of an object point at a distance that may change with time.
transfer    Transfer functions: each factor of the blur over spatial frequency.
choose      The cheapest model of the PSF that keeps a tolerance, and why.
validity    How far the Fresnel integral may be trusted: the paper's criterion, and a stable one.
pixel_psf   Optics enter; a Psf leaves: the fraction of light in each pixel, for any sub-pixel
            place.
over_field  Optics -> Psf at places in the field, where aberrations grow away from the axis.
quality     Psf -> the numbers by which optics are judged: transfer at Nyquist, energies, widths.
baffle      Light -> Light: what Sun, Moon and Earth send past the baffle becomes a veil over the
            frame.
"""

from startrack.optics.airy import airy
from startrack.optics.baffle import Baffle, stray_light
from startrack.optics.choose import Choice, choose
from startrack.optics.fraunhofer import intensity, pupil_samples
from startrack.optics.over_field import at_field, over_field
from startrack.optics.parameters import Optics
from startrack.optics.pixel_psf import pixel_psf, pixel_response
from startrack.optics.pupil import Pupil, Segment, cells, openness
from startrack.optics.quality import BLOCKS, POINT, RADII, Quality, encircled, modulation, quality
from startrack.optics.transfer import blur_transfer, pixel_transfer, pupil_transfer
from startrack.optics.zernike import Aberration, zernike

# Public; the other imports serve other rooms.
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
    "modulation",
    "over_field",
    "pixel_psf",
    "pixel_response",
    "pixel_transfer",
    "pupil_transfer",
    "quality",
    "stray_light",
]
