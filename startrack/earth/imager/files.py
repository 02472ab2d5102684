"""FITS file filled during rendering; GeoTIFF with ground control points."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import gib
from startrack.earth.atmosphere import Terms
from startrack.earth.imager.render import Picture
from startrack.earth.terrain import require_rasterio
from startrack.io import whole

BLOCK = 2880  # bytes of a FITS block; parts of a file are padded to blocks
POINTS = 9  # ground control points along each side of the image; chosen by hand
# The terms of the radiance in the file of a picture, with the comments in its header.
ABOUT: dict[str, str] = {
    "direct": "sunlight that the ground reflects",
    "indirect": "light of sky and slopes that the ground reflects",
    "scattered": "light that the air scatters",
    "emitted": "heat of the ground",
    "thermal": "heat of the air",
}
RADIANCE = "W m-2 sr-1 um-1"


def open_fits(path: Path, lines: int, columns: int, cards: dict[str, Any]) -> Picture:
    """A picture whose arrays are parts of a new FITS file at `path`.

    The file has its final size at once; pixels not yet filled in are zero.

    cards  cards of the first header, each a value or (value, comment)
    """
    from astropy.io import fits

    parts = [fits.PrimaryHDU(np.zeros((1, 1), np.int32))]
    for key, value in cards.items():
        parts[0].header[key] = value
    for name, text in ABOUT.items():
        part = fits.ImageHDU(np.zeros((1, 1), np.float32), name=name)
        part.header["BUNIT"] = RADIANCE
        part.header.add_comment(text)
        parts.append(part)
    for name in ("longitude", "latitude"):
        parts.append(fits.ImageHDU(np.zeros((1, 1)), name=name))
        parts[-1].header["BUNIT"] = "deg"
    require_room(path, 40 * lines * columns)
    positions = []
    with path.open("wb") as file:
        for part in parts:
            part.header["NAXIS1"], part.header["NAXIS2"] = columns, lines
            file.write(part.header.tostring().encode("ascii"))
            kind = np.dtype({32: ">i4", -32: ">f4", -64: ">f8"}[part.header["BITPIX"]])
            positions.append((file.tell(), kind))
            size = lines * columns * kind.itemsize
            file.seek(-(-size // BLOCK) * BLOCK, 1)
        file.truncate(file.tell())
    arrays = [np.memmap(path, kind, "r+", offset, (lines, columns)) for offset, kind in positions]
    return Picture(arrays[0], Terms(*arrays[1:6]), arrays[6], arrays[7])


def require_room(path: Path, size: int) -> None:
    """Refuse a file without room on the disk: a write to its memory map would end the process.

    Raises  OSError with the needed and the free bytes.
    """
    free = shutil.disk_usage(path.parent).free
    if size > free:
        raise OSError(f"{path.parent} must have room for {gib(size)}, but has {gib(free)}")


def write_geotiff(path: Path, picture: Picture) -> None:
    """Write numbers and terms as bands, with ground control points on a lattice.

    Raises  ImportError without rasterio; ValueError if the image shows too little ground.
    """
    rasterio = require_rasterio("to write GeoTIFF")
    lines, columns = picture.numbers.shape
    points = [
        rasterio.control.GroundControlPoint(
            j + 0.5, i + 0.5, float(picture.longitude[j, i]), float(picture.latitude[j, i])
        )
        for j in np.linspace(0, lines - 1, POINTS).round().astype(int)
        for i in np.linspace(0, columns - 1, POINTS).round().astype(int)
        if np.isfinite(picture.longitude[j, i])
    ]
    if len(points) < 3:
        raise ValueError(f"a GeoTIFF needs 3 points of ground, got {len(points)}")
    names = ("digital number", *(f"{name} ({RADIANCE})" for name in ABOUT))
    bands = dict(zip(names, (picture.numbers, *picture.terms), strict=True))
    write_bands(path, bands, "float32", {"gcps": points, "crs": "EPSG:4326"})


def write_bands(
    path: Path,
    bands: Mapping[str, NDArray[Any]],
    kind: str,
    place: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
    tags: Mapping[str, Any] | None = None,
) -> None:
    """Arrays of one shape as a GeoTIFF.

    kind   NumPy type of the numbers
    place  georeference and further options of GDAL
    units  unit of each band
    Raises  ImportError without rasterio.
    """
    rasterio = require_rasterio("to write GeoTIFF")
    rows, columns = next(iter(bands.values())).shape
    options = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": len(bands),
        "dtype": kind,
        "compress": "deflate",
        **place,
    }
    with whole(path) as draft, rasterio.open(draft, "w", **options) as file:
        file.update_tags(**(tags or {}))
        for n, (name, values) in enumerate(bands.items(), 1):
            file.set_band_description(n, name)
            if units:
                file.set_band_unit(n, units[name])
            file.write(np.asarray(values, kind), n)


def thinned(values: NDArray[Any], most: int) -> NDArray[Any]:
    """Lines and columns at a constant step, at most `most` of each."""
    step = max(1, -(-max(values.shape) // most))
    return np.asarray(values[::step, ::step])
