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
from startrack.detector.excess import (
    Numbers,
    Rates,
    Tilt,
    excesses,
    numbers_of,
    rates_for,
    tilt_for,
)
from startrack.detector.expose import arriving, expected, expose, frame_of, seen
from startrack.detector.grid import star_grid
from startrack.detector.ground import ground, ground_tables
from startrack.detector.hits import Hits
from startrack.detector.lines import Line, Scan, staggered, tdi
from startrack.detector.maps import dark, response
from startrack.detector.parameters import Detector, Region
from startrack.detector.pattern import Pattern
from startrack.detector.poisson import poisson_quantile
from startrack.detector.readout import read_out
from startrack.detector.scan import scan, scanned
from startrack.detector.shutter import Turn
from startrack.detector.thermal import Thermal
from startrack.detector.windows import (
    expose_within,
    lone_pixels,
    odd_pixels,
    only_lone_pixels,
    put,
)

__all__ = [
    "Defects",
    "Detector",
    "Hits",
    "Line",
    "Numbers",
    "Pattern",
    "Rates",
    "Region",
    "Scan",
    "Thermal",
    "Tilt",
    "Turn",
    "arriving",
    "dark",
    "electron_rate",
    "excesses",
    "expected",
    "expose",
    "expose_within",
    "frame_of",
    "ground",
    "ground_tables",
    "lone_pixels",
    "numbers_of",
    "odd_pixels",
    "only_lone_pixels",
    "poisson_quantile",
    "put",
    "rates_for",
    "read_out",
    "response",
    "scan",
    "scanned",
    "seen",
    "staggered",
    "star_grid",
    "tdi",
    "tilt_for",
]
