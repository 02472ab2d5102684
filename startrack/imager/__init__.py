"""An Earth camera: Survey -> pictures in digital numbers, with their radiance in five terms.

parameters  Channel, Imager, Survey: the camera, the land and the air
read        a scene file -> Survey; cameras of the catalogue
through     Channel and Air -> the band of a channel
blur        optics, motion and rays -> weights
render      Survey and Channel -> Picture
files       Picture -> FITS on disk as it grows; GeoTIFF
"""

from startrack.imager.files import ABOUT, open_fits, thinned, write_geotiff
from startrack.imager.parameters import Channel, Imager, Survey
from startrack.imager.read import cameras, load_imager, load_survey
from startrack.imager.render import Picture, Setting, gathered, prepare, render

__all__ = [
    "ABOUT",
    "Channel",
    "Imager",
    "Picture",
    "Setting",
    "Survey",
    "cameras",
    "gathered",
    "load_imager",
    "load_survey",
    "open_fits",
    "prepare",
    "render",
    "thinned",
    "write_geotiff",
]
