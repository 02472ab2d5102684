"""Products of an Earth camera: raw numbers to radiance, reflectance and a map on the terrain.

retrieval  Dark and flat frames of a channel; raw numbers -> radiance -> reflectance or temperature
           of the ground.
uncertainty  Uncertainty of each pixel by contributors, from the uncertainty of the inputs.
ortho      Line and column of points of the ground in an image; an image on a grid of a map
           projection, with the quality of each cell.
files      FITS of raw images and calibration frames; GeoTIFF of products.
chain      A product of a channel from its raw image and its calibration frames.
"""

from startrack.earth.product.chain import (
    UNITS,
    Product,
    ProductSettings,
    against_truth,
    make_product,
)
from startrack.earth.product.files import (
    camera_id,
    read_calibration,
    read_raw,
    save_calibration,
    scene_ids,
    write_product,
    write_quality,
)
from startrack.earth.product.ortho import QUALITY, MapGrid, place_cells, resample
from startrack.earth.product.retrieval import brightness_temperature, calibrate, to_radiance

# Public; the other imports serve other rooms.
__all__ = [
    "MapGrid",
    "ProductSettings",
    "brightness_temperature",
    "calibrate",
    "make_product",
    "to_radiance",
]
