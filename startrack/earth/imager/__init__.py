"""Images of Earth cameras: radiance, PSF, detector, digital numbers.

brdf            Reflectance of land, water and snow from the directions of Sun and camera.
land            Reflectance and temperature of ground: covers by height, maps, texture, slopes, hot
                spots.
parameters      Imager, its channels, and Survey (camera, land and air of an Earth image), and
                their files.
spectrum_file   Text file of a spectral library, a filter or a detector, and its Curve.
band            BandTable and thermal radiance of one channel, weighted with its response.
lens            The lens of a channel over its field: directions of pixels, images of points,
                illumination; weights of the rays around a pixel.
adjacency       Reflectance of the ground around each pixel, mixed by the air into lines of sight.
clouds          Cloud layers of a scene, and their optical depth over the ground.
cloud_radiance  Radiance of ground and air under cloud layers, of the layers, and their shadows.
figures         Resolution, swath, MTF, SNR and data rate of a channel; first parameters from goals.
render          An image from Survey and Channel: radiance at the sensor in five terms, and digital
                numbers.
restore         Restoration of images, blurred by lens, pixel and smear, by a Wiener filter.
files           FITS file filled during rendering; GeoTIFF with ground control points.
"""

from startrack.earth.imager.adjacency import Environment, Plane, leaving, surrounded
from startrack.earth.imager.band import (
    HAZIEST,
    INFRARED,
    Band,
    air_table,
    band_of,
    mean_wavelength,
    table_in_bands,
    terms_in_band,
)
from startrack.earth.imager.brdf import (
    Angles,
    RossLi,
    Snow,
    Water,
    fresnel,
    glint,
    kernel_albedos,
    kernels,
    sky_factor,
)
from startrack.earth.imager.clouds import CloudLayer, Sheet, open_sheets
from startrack.earth.imager.figures import (
    Figures,
    First,
    Goals,
    figures,
    figures_of,
    first_parameters,
    known,
    margins_of,
)
from startrack.earth.imager.files import (
    ABOUT,
    RADIANCE,
    open_fits,
    thinned,
    write_bands,
    write_geotiff,
)
from startrack.earth.imager.land import (
    ROUGHNESS,
    TEXELS,
    Cover,
    HotSpot,
    Land,
    ReflectanceMap,
    cover_at,
)
from startrack.earth.imager.lens import (
    blur_strips,
    blur_weights,
    lens_registration,
    point_images,
    smeared,
)
from startrack.earth.imager.parameters import (
    CHANNELS,
    Channel,
    Imager,
    Knowledge,
    Passband,
    Performance,
    Reference,
    Spectrometer,
    Survey,
    cameras,
    exposure_of,
    load_imager,
    load_survey,
    require_pace,
    scene_of,
    smear,
)
from startrack.earth.imager.render import (
    MOST_LINES,
    Picture,
    Setting,
    around_of,
    as_matrix,
    image_blur,
    lines_apart,
    misregistration,
    pixel_electrons,
    prepare,
    render,
    setting_below,
)
from startrack.earth.imager.restore import Restoration, restoration_of

# Public; the other imports serve other rooms.
__all__ = [
    "Channel",
    "CloudLayer",
    "Cover",
    "HotSpot",
    "Imager",
    "Knowledge",
    "Land",
    "Passband",
    "Performance",
    "Picture",
    "Plane",
    "Reference",
    "ReflectanceMap",
    "RossLi",
    "Snow",
    "Spectrometer",
    "Survey",
    "Water",
    "load_imager",
    "load_survey",
    "prepare",
    "render",
]
