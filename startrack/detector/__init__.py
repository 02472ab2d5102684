"""Photons into numbers, in the order of nature: photons, charge, pixel, signal, image.

parameters  Detector: pixels, exposure, noise, converter; None or zero for what it does not have

photons     collect    Light -> electrons per second that each star and each pixel of sky delivers
            glow       what of the sky varies over the field
            stamp      the PSF of each star, added to the image at its sub-pixel place
            shutter    where stars are while the rows are exposed, globally or rolling
            lines      where the lines of a detector look, and when
            scan       lines, staggered lines and TDI: an image that grows with time
charge      defects    response of each pixel, DSNU, hot and dead pixels and columns
            crosstalk  electrons that diffuse into the next pixels
            thermal    dark current over temperature, reset noise
            lag        charge left to the next frame
            maps       all that belongs to a device, made once
            ground     expected electrons where no star is
            expose     Light, Psf, Path -> expected electrons -> Frame
            windows    the same in windows of a frame
            grid       stars of all fluxes at all places in the pixel, without noise
            excess     where noise alone passes a filter's level, without the frame
pixel       hits       tracks of cosmic rays and protons
            bloom      charge beyond the full well
            multiply   the register of an EMCCD
signal      settle     impulse response of the read-out channel
            pattern    row and column noise
            law        non-linearity, gain, offset, converter
image       digitise   expected electrons -> numbers at once, through the exact law
            readout    the same, or all steps where pixels know of each other

Below them: counter (random bits of a pixel), normal and poisson (quantiles), tables (the law).
"""

from startrack.detector.collect import electron_rate
from startrack.detector.defects import Defects
from startrack.detector.expose import expected, expose, frame_of
from startrack.detector.hits import Hits
from startrack.detector.lines import Line, Scan, staggered, tdi
from startrack.detector.parameters import Detector, Region
from startrack.detector.pattern import Pattern
from startrack.detector.poisson import poisson_quantile
from startrack.detector.readout import read_out
from startrack.detector.scan import scan
from startrack.detector.tables import Tables
from startrack.detector.thermal import Thermal

__all__ = [
    "Defects",
    "Detector",
    "Hits",
    "Line",
    "Pattern",
    "Region",
    "Scan",
    "Tables",
    "Thermal",
    "electron_rate",
    "expected",
    "expose",
    "frame_of",
    "poisson_quantile",
    "read_out",
    "scan",
    "staggered",
    "tdi",
]
