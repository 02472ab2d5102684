"""Photons into numbers: photons, charge, pixels, signal, image (EMVA 1288).

parameters           Detector: pixels, exposure, noise, converter, optional effects; Line, Scan:
                     detectors of lines (one line, staggered lines, TDI).
imperfections        Thermal, Hits, Defects, Pattern: what a real detector adds to an ideal one.
ageing               Orbit, shielding, years and a family of detectors -> what radiation did to
                     their pixels.
mosaic               ColourMosaic: filters of three colours before the pixels of an array.
maps                 Maps of one device: response, dark current and read noise of each pixel.
collect              Light and detector -> electrons of stars, of the background and of diffuse
                     light (equation 4).
stamp                Stars onto pixels: six-point Lagrange interpolation of the table of the PSF.
law                  Signal chain of a pixel, and tables of the exact distribution of its digital
                     number.
digitise             Expected electrons -> digital numbers: one uniform number a pixel, exact
                     distribution.
effects              Effects on the pixels of a frame, one table in the order of the physics:
                     charge, signal, image.
readout              Expected electrons -> digital numbers: independent pixels at once, others
                     effect by effect.
exposure             Exposure: what a frame depends on -> expected electrons, and a Frame.
windows              Stars and windows -> a Frame whose numbers are valid inside these windows
                     alone.
threshold_crossings  Filter and thresholds -> where noise alone exceeds them, and the numbers of the
                     pixels there.
scan                 Light and the motion of a camera -> the image of a detector of lines.
"""

from startrack.detector.ageing import (
    CHANDRA_ACA,
    Age,
    Flicker,
    Flickering,
    orbit_dose,
    pixels_above,
    proton_dose,
)
from startrack.detector.collect import diffuse, diffuse_electrons, electron_rate, mean_wavelength
from startrack.detector.digitise import normals, shot
from startrack.detector.effects import (
    PIXEL_EFFECTS,
    EffectInput,
    added_noise,
    multiplied,
    read_channel,
    read_out_transfer,
    require_independent_pixels,
)
from startrack.detector.exposure import (
    Exposure,
    MotionFunction,
    arriving,
    dark_frames,
    expected,
    expose,
    frame_of,
    seen,
    star_grid,
    to_frame,
)
from startrack.detector.imperfections import Defects, Hits, Pattern, Thermal, offsets
from startrack.detector.law import BITS, alternating_numbers, expected_signal, law_of, tables_for
from startrack.detector.maps import dark, device_streams, flickering, read_noise, response
from startrack.detector.mosaic import ColourMosaic
from startrack.detector.parameters import Detector, Line, RegionOfInterest, Scan, staggered, tdi
from startrack.detector.readout import read_out
from startrack.detector.scan import LineExposure, scan
from startrack.detector.stamp import stamp
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
    "ColourMosaic",
    "Defects",
    "Detector",
    "EffectInput",
    "Exposure",
    "Flicker",
    "Hits",
    "Line",
    "LineExposure",
    "Pattern",
    "RegionOfInterest",
    "Scan",
    "Thermal",
    "expected",
    "expose",
    "orbit_dose",
    "proton_dose",
    "scan",
    "staggered",
    "tdi",
]
