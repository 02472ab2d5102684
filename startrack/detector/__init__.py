"""Photons into numbers: photons, charge, pixels, signal, image (EMVA 1288).

parameters           Detector: pixels, exposure, noise, converter, and optional effects.
thermal              Thermal: growth of the dark current with temperature, reset noise.
hits                 Hits: cosmic rays and protons, straight tracks of charge.
nonuniformity        Defects, Pattern: what differs between pixels, and between rows and columns.
lines                Line, Scan: detectors of lines (one line, staggered lines, TDI).
shielding            Orbit and shielding -> dose of protons behind aluminium, and its damage.
ageing               Age: dose, years and a family of detectors -> what radiation did to its
                     pixels.
maps                 Maps of one device: response, dark current and read noise of each pixel.
collect              Light and detector -> electrons of stars, of the background and of diffuse
                     light (equation 4).
shutter              Positions of stars during the exposure, with a global or a rolling shutter.
stamp                Stars onto pixels: six-point Lagrange interpolation of the table of the PSF.
effects              Residual charge, crosstalk, blooming, electron multiplication, settling.
extension_effects    Charge, signal or image of a frame -> the same after effects that are not part
                     of startrack.
law                  Signal chain of a pixel: its digital number from its electrons and its read
                     noise.
tables               Tables of the exact distribution of digital numbers, one for each level of
                     expected electrons.
digitise             Expected electrons -> digital numbers: one uniform number a pixel, exact
                     distribution.
dark_frames          Detector -> the mean of dark frames that are taken to calibrate it.
pixel_effects        The effects by which pixels depend on each other, or on the frame before: one
                     table of rows.
readout              Expected electrons -> digital numbers with all effects: charge, signal, image.
expose               Exposure: what a frame depends on -> expected electrons, and a Frame.
windows              Stars and windows -> a Frame whose numbers are valid inside these windows
                     alone.
threshold_crossings  Filter and thresholds -> where noise alone exceeds them, and the numbers of the
                     pixels there.
scan                 Light and the motion of a camera -> the image of a detector of lines.
star_grid            Stars and companions -> one noise-free Frame with a cell for each star.
"""

from startrack.detector.ageing import (
    CHANDRA_ACA,
    YEAR,
    Age,
    Flicker,
    Flickering,
    TailLaw,
    pixels_above,
    tail_currents,
)
from startrack.detector.collect import electron_rate, mean_wavelength
from startrack.detector.dark_frames import dark_frames
from startrack.detector.digitise import normals, shot
from startrack.detector.effects import diffuse, settle
from startrack.detector.expose import (
    Exposure,
    arriving,
    expected,
    expose,
    frame_of,
    seen,
    to_frame,
)
from startrack.detector.extension_effects import Effect, EffectInput
from startrack.detector.hits import Hits
from startrack.detector.law import law_of, nonlinear_signal, with_adc_inl
from startrack.detector.lines import Line, Scan, staggered, tdi
from startrack.detector.maps import dark, device_streams, flickering, read_noise, response
from startrack.detector.nonuniformity import Defects, Pattern, offsets
from startrack.detector.parameters import Detector, RegionOfInterest
from startrack.detector.pixel_effects import PIXEL_EFFECTS, PixelEffect, require_independent_pixels
from startrack.detector.readout import read_out
from startrack.detector.scan import scan
from startrack.detector.shutter import MotionFunction
from startrack.detector.stamp import stamp
from startrack.detector.star_grid import star_grid
from startrack.detector.tables import Tables
from startrack.detector.thermal import Thermal
from startrack.detector.threshold_crossings import (
    NumberDistributions,
    ProposalRates,
    TiltedLaw,
    number_distributions,
    proposal_rates,
    threshold_crossings,
    tilted_law,
)
from startrack.detector.windows import (
    expose_within,
    independent_pixels,
    outlier_pixels,
    write_numbers,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Age",
    "Defects",
    "Detector",
    "Effect",
    "EffectInput",
    "Exposure",
    "Flicker",
    "Flickering",
    "Hits",
    "Line",
    "Pattern",
    "RegionOfInterest",
    "Scan",
    "Tables",
    "TailLaw",
    "Thermal",
    "electron_rate",
    "expected",
    "expose",
    "frame_of",
    "pixels_above",
    "read_out",
    "scan",
    "staggered",
    "tdi",
]
