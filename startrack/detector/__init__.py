"""Photons into numbers: photons, charge, pixels, signal, image (EMVA 1288).

parameters           Detector: pixels, exposure, noise, converter, and what else a design may
                     name.
thermal              Temperature: how the dark current grows, and the noise that resetting a
                     capacitor leaves.
hits                 Hits: cosmic rays and protons leave straight tracks of charge.
pattern              Pattern: noise that the pixels of a row or of a column share.
defects              Defects: what the pixels of one copy of a detector do wrong, as maps that
                     never change.
maps                 Maps of a device: what each pixel does on its own, the same in all trials.
collect              Light enters; electrons per second of stars, sky and diffuse light leave
                     (equation 4).
stamp                Stars onto pixels: each PSF at its sub-pixel place, read from the table by
                     six-point Lagrange.
shutter              Where stars are while the rows of a frame are exposed, by a global or a
                     rolling shutter.
effects              Effects on charge and signal: residual charge, crosstalk, blooming, EM gain,
                     settling.
law                  Law: what the number of a pixel is, given the electrons that it caught and
                     the read noise.
tables               Tables of the exact law of a pixel's number, one for each level of expected
                     electrons.
background           Sky and detector -> what each pixel expects where no star is.
digitise             Expected electrons -> numbers at once: one uniform number a pixel, through
                     the exact law.
threshold_crossings  A filter, its levels -> where noise alone passes them, and the numbers of the
                     pixels there.
readout              Expected electrons -> digital numbers: charge, signal, image.
expose               Light, Psf, Path -> Frame.
windows              Stars and regions -> a Frame that holds the right numbers around these
                     regions alone.
lines                Lines of pixels: where each looks, when and with what gain; a line, staggered
                     lines, TDI.
scan                 Lines, staggered lines and TDI: Light and a turning camera -> an image that
                     grows in time.
star_grid            A detector, a PSF, stars and companions -> one Frame with a cell for each
                     star, without noise.
"""

from startrack.detector.collect import electron_rate
from startrack.detector.defects import Defects
from startrack.detector.digitise import normals, shot
from startrack.detector.effects import diffuse, settle
from startrack.detector.expose import arriving, expected, expose, frame_of, seen
from startrack.detector.hits import Hits
from startrack.detector.law import law_of
from startrack.detector.lines import Line, Scan, staggered, tdi
from startrack.detector.maps import dark, device_streams, read_noise, response
from startrack.detector.parameters import Detector, RegionOfInterest
from startrack.detector.pattern import Pattern, offsets
from startrack.detector.readout import read_out
from startrack.detector.scan import scan
from startrack.detector.shutter import Course
from startrack.detector.stamp import stamp
from startrack.detector.star_grid import star_grid
from startrack.detector.tables import Tables
from startrack.detector.thermal import Thermal
from startrack.detector.threshold_crossings import (
    Numbers,
    Rates,
    Tilt,
    numbers_of,
    rates_for,
    threshold_crossings,
    tilt_for,
)
from startrack.detector.windows import (
    expose_within,
    independent_pixels,
    outlier_pixels,
    put,
    require_independent_pixels,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Defects",
    "Detector",
    "Hits",
    "Line",
    "Pattern",
    "RegionOfInterest",
    "Scan",
    "Tables",
    "Thermal",
    "electron_rate",
    "expected",
    "expose",
    "frame_of",
    "read_out",
    "scan",
    "staggered",
    "tdi",
]
