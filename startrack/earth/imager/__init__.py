"""Images of Earth cameras: radiance, PSF, detector, digital numbers.

land        Ground -> what it reflects and how warm it is: covers by height, texture, slopes, hot
            spots.
parameters  Imager, its channels, and Survey (camera, land and air of an Earth image), and their
            files.
through     Channel and Air -> BandTable and Heat of its one band, weighted as the detector counts
            light.
blur        Optics, motion and the rays of each pixel -> weights by which rays around it make the
            pixel.
figures     Channel, height and speed -> ground resolution, swath, sharpness, SNR, dynamics, data
            rate.
first       Goals -> the first parameters of a camera: focal length, aperture, clock; what asks
            for each.
render      Survey and Channel -> a picture: radiance at the sensor in five terms, and digital
            numbers.
files       Picture -> FITS that grows on disk while it is rendered; and GeoTIFF with its ground
            points.
"""

from startrack.earth.imager.figures import Figures, figures, reference
from startrack.earth.imager.files import ABOUT, open_fits, thinned, write_geotiff
from startrack.earth.imager.first import First, Goals, first_parameters
from startrack.earth.imager.land import Cover, HotSpot, Land
from startrack.earth.imager.parameters import (
    Channel,
    Imager,
    Survey,
    cameras,
    load_imager,
    load_survey,
)
from startrack.earth.imager.render import Picture, Setting, gathered, prepare, render
from startrack.earth.imager.through import Band, band_of

# Public; the other imports serve other rooms.
__all__ = [
    "ABOUT",
    "Band",
    "Channel",
    "Cover",
    "Figures",
    "First",
    "Goals",
    "HotSpot",
    "Imager",
    "Land",
    "Picture",
    "Setting",
    "Survey",
    "band_of",
    "cameras",
    "figures",
    "first_parameters",
    "gathered",
    "load_imager",
    "load_survey",
    "open_fits",
    "prepare",
    "reference",
    "render",
    "thinned",
    "write_geotiff",
]
