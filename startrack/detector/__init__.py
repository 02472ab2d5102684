"""Photons into numbers, in the order of nature: photons, charge, pixel, signal, image.

parameters  Detector: pixels, exposure, noise, converter
collect     Light -> electrons per second that each star and each pixel of sky delivers
stamp       the PSF of each star, added to the image at its sub-pixel place
poisson     shot noise as a quantile, so that two designs can share their noise
effects     what each pixel does: response non-uniformity, dark current
readout     electrons -> digital numbers: shot noise, full well, read noise, converter
expose      Light, Psf, Path -> Frame
"""

from startrack.detector.collect import electron_rate
from startrack.detector.expose import expected, expose
from startrack.detector.parameters import Detector
from startrack.detector.poisson import poisson_quantile

__all__ = ["Detector", "electron_rate", "expected", "expose", "poisson_quantile"]
