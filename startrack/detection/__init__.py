"""Numbers into spots.

parameters  Detection: what counts as a spot
dark        Frame, dark frame -> Frame without the fixed pattern
flat        Frame, flat field -> Frame of even response; known hot pixels marked
pixels      Frame -> Pixels: float32 without holes
robust      background and noise of pixels that stars may be among
background  filtered image -> Sky: its background and noise, tile by tile
matched     image -> filtered image, by the kernel of a Gaussian or of the design's PSF
law         how far its noise reaches, by the gain model or by the skewness it shows
connect     filtered image, level -> Peaks of its connected components
between     how far a peak stands out, at the best place between the pixels
split       Peaks -> more of them, where the filter has merged stars
examine     Peaks -> which of them are no stars
find        Pixels -> Candidates: peaks that look like stars
rate        how many false spots noise makes, and the threshold for as many
sample      what every centroid works on, and a pixel's noise
gravity     centre of gravity
s_curve     its error over the star's place in the pixel, from the PSF
weighted    centre of gravity under a Gaussian weight that follows the star
psf_table   share of a star's light in each pixel
smear       the PSF of a star that moves
gaussian_star  share of a Gaussian star's light in each pixel
scoring     one step of a fit
fit         the steps, for stars that touch together
gaussian    fit of a Gaussian
likelihood  fit of the design's PSF
centroid    Candidates -> Spots, by one of these four
detect      Frame -> Spots
response    how a centroid answers to each of its pixels
windows     Frame, predicted places -> Spots
within      Frame known in regions alone -> Spots
expectation Frame without noise -> what to expect of its stars
"""

from startrack.detection.dark import subtract_dark
from startrack.detection.detect import detect
from startrack.detection.flat import divide_flat, without_pixels
from startrack.detection.parameters import Detection
from startrack.detection.psf_table import gaussian_psf
from startrack.detection.rate import false_alarms, threshold_of
from startrack.detection.smear import smeared
from startrack.detection.windows import detect_near

__all__ = [
    "Detection",
    "detect",
    "detect_near",
    "divide_flat",
    "false_alarms",
    "gaussian_psf",
    "smeared",
    "subtract_dark",
    "threshold_of",
    "without_pixels",
]
