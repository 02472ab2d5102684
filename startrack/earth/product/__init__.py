"""Products of an Earth camera: raw numbers to radiance, reflectance and a map on the terrain.

calibration  Dark and flat frames of a channel, and the radiance of raw numbers.
retrieval    Reflectance or temperature of the ground from radiance at the sensor.
locate       Line and column at which a camera in flight sees points of the ground.
ortho        An image on a grid of a map projection, with the quality of each cell.
files        FITS of raw images and calibration frames; GeoTIFF of products.
chain        A product of a channel from its raw image and its calibration frames.
"""

from startrack.earth.product.calibration import Calibration, calibrate, to_radiance
from startrack.earth.product.chain import UNITS, Product, Settings, against_truth, make_product
from startrack.earth.product.files import (
    RawImage,
    camera_id,
    read_calibration,
    read_raw,
    save_calibration,
    write_product,
    write_quality,
)
from startrack.earth.product.locate import Locator
from startrack.earth.product.ortho import (
    CLOUD,
    CLOUD_SHADOW,
    HIDDEN,
    NO_DATA,
    QUALITY,
    SATURATED,
    MapGrid,
)
from startrack.earth.product.retrieval import (
    Retrieval,
    apparent_reflectance,
    brightness_temperature,
    retrieve,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Calibration",
    "Locator",
    "MapGrid",
    "Product",
    "RawImage",
    "Retrieval",
    "Settings",
    "against_truth",
    "apparent_reflectance",
    "brightness_temperature",
    "calibrate",
    "camera_id",
    "make_product",
    "read_calibration",
    "read_raw",
    "retrieve",
    "save_calibration",
    "to_radiance",
    "write_product",
    "write_quality",
]
