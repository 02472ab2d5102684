"""The detector, from photons to digital numbers: photons, charge, signal, image (EMVA 1288).

parameters           Detector: pixels, exposure, noise, converter, optional effects; Line, Scan:
                     detectors of lines (one line, staggered lines, TDI).
imperfections        Thermal, Hits, Defects, Pattern: imperfections of a real detector.
ageing               Orbit, shielding, years and a family of detectors -> radiation damage of their
                     pixels.
mosaic               ColourMosaic: filters of three colours before the pixels of an array.
maps                 Maps of one device: response, dark current and read noise of each pixel.
collect              Light and detector -> electrons of stars, of the background and of diffuse
                     light (equation 4).
stamp                Stars onto pixels: six-point Lagrange interpolation of the table of the PSF.
law                  Signal chain of a pixel, and tables of the exact distribution of its digital
                     number.
digitise             Expected electrons -> digital numbers of independent pixels, by the exact
                     distribution.
effects              Effects on the pixels of a frame, one table in the order of the physics:
                     charge, signal, image.
readout              Expected electrons -> digital numbers: in one step for independent pixels, else
                     effect by effect.
exposure             Exposure: the inputs of a frame -> expected electrons, and a Frame.
windows              Stars and windows -> a Frame whose numbers are valid only inside these windows.
threshold_crossings  Filter and thresholds -> pixels where noise alone exceeds the threshold, and
                     the digital numbers around them.
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
