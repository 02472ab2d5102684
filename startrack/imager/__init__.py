"""An Earth camera: Survey -> pictures in digital numbers, with their radiance in five terms.

parameters  Channel, Imager, Survey: the camera, the land and the air
read        a scene file -> Survey; cameras of the catalogue
through     Channel and Air -> the band of a channel
blur        optics, motion and rays -> weights
render      Survey and Channel -> Picture
figures     Channel, height and speed -> ground resolution, MTF, SNR, dynamics, data rate
first       Goals -> focal length, aperture, clock
files       Picture -> FITS on disk as it grows; GeoTIFF
"""

from startrack.imager.figures import Figures, figures, reference
from startrack.imager.files import ABOUT, open_fits, thinned, write_geotiff
from startrack.imager.first import First, Goals, first_parameters
from startrack.imager.parameters import Channel, Imager, Survey
from startrack.imager.read import cameras, load_imager, load_survey
from startrack.imager.render import Picture, Setting, gathered, prepare, render
from startrack.imager.through import Band, band_of

__all__ = [
    "ABOUT",
    "Band",
    "Channel",
    "Figures",
    "First",
    "Goals",
    "Imager",
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
