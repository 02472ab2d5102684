"""How near is a rendered image to a real one of the same terrain, Sun and view?

The image is band 4 (775 to 900 nm) of Landsat 7 ETM+ of 25 November 2002, path 15, row 32, 300 x
300 pixel of ridges and valleys in Pennsylvania, with the terrain model of the same cells: the data
`nov4` and `dem` of the package `landsat` for R (S. Goslee, CRAN; github.com/cran/landsat), read
from `--landsat FOLDER` with the package rdata. When this file was written, only the image's date,
Sun, gains and position were known, not its pixels.

The scene: Lambertian ground of reflectance 0.25 everywhere, so that all contrast is of slopes and
shadows; rural air of 23 km of visibility; a line camera at 100 km with pixels of 30 m, on the axis
the modulation that is published of ETM+ (0.3 at Nyquist frequency, 0.64 of it by the pixel), its
gain (0.637 W / (m2 sr um) a digital number, 8 bits) and a noise of 0.8 digital numbers.

`PREDICTED` was committed before the pixels were read: the expected range of each figure.
"""

from __future__ import annotations

import importlib
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter1d, minimum_filter1d
from scipy.special import erfinv

from startrack import deg, nm, um
from startrack.core import Curve
from startrack.detector import Detector, Scan
from startrack.earth.atmosphere import Air
from startrack.earth.geometry import Aircraft, MapFile, Terrain
from startrack.earth.imager import (
    Channel,
    Cover,
    Imager,
    Land,
    Picture,
    ReflectanceMap,
    Survey,
    prepare,
    render,
)
from startrack.earth.product import MapGrid, calibrate, place_cells, resample, to_radiance
from startrack.optics import Optics

Floats = NDArray[np.float64]
PREDICTED = {
    # Over slopes of more than 10 degrees, which are wooded: one cover.
    "real_shading_correlation": (0.75, 0.55, 0.9),
    # Over all: fields in the valleys are of many covers.
    "real_shading_correlation_all": (0.5, 0.3, 0.7),
    # Relative contrast of slopes over the rendered one: trees grow upright.
    "real_shading_slope": (0.75, 0.5, 1.0),
    # Real over rendered, in the most even windows; no ground is quite even.
    "real_noise_ratio": (1.2, 0.8, 2.0),
    # Real over rendered, of the sharpest edges; no field ends within a metre.
    "real_mtf_ratio": (0.85, 0.6, 1.2),
    # Pixel between real and rendered shading; the product was fitted to ground control.
    "real_place_px": (0.7, 0.0, 1.5),
}
GAIN, BIAS = 0.63725, -5.1  # W / (m2 sr um) a digital number, and at zero: the package's own table
STEEP = 10 * deg
INNER = slice(12, -12)  # cells of the map, without its edges
WINDOW = 5  # pixel, of the noise
BEST = 2.0  # per cent of windows: the most even ones
EDGES = 98.0  # percentile of contrast, and the sharpest twentieth of those


def compare(folder: Path) -> dict[str, Any]:
    """Figures of the real image over those of the rendered one."""
    terrain, grid = read(folder / "dem.rda")
    counts, same = read(folder / "nov4.rda")
    if same != grid:
        raise ValueError(f"image and terrain must have the same cells, got {same} and {grid}")
    return figures_of(GAIN * counts + BIAS, terrain, grid)


def figures_of(real: Floats, terrain: Floats, grid: MapGrid) -> dict[str, Any]:
    """The figures of an image (rows, columns) in W / (m2 sr um), and the images themselves."""
    with tempfile.TemporaryDirectory() as name:
        shaded = rendered(terrain, grid, Path(name), None)
        fields = rendered(np.full_like(terrain, terrain.mean()), grid, Path(name), checkers(grid))
    inner = (INNER, INNER)
    slope = np.hypot(*np.gradient(terrain, grid.step_y))
    steep = (slope > np.tan(STEEP))[inner]
    ours, theirs = shaded[inner], real[inner]
    gain = np.polyfit(ours[steep] / ours[steep].mean(), theirs[steep] / theirs[steep].mean(), 1)[0]
    return {
        "real_shading_correlation": float(np.corrcoef(ours[steep], theirs[steep])[0, 1]),
        "real_shading_correlation_all": float(np.corrcoef(ours.ravel(), theirs.ravel())[0, 1]),
        "real_shading_slope": float(gain),
        "real_noise_ratio": noise(theirs) / noise(ours),
        "real_mtf_ratio": modulation(theirs) / modulation(fields[inner]),
        "real_place_px": float(np.hypot(*shift(ours, theirs))),
        "steep_share": float(steep.mean()),
        "images": (ours, theirs, fields[inner]),
    }


def read(path: Path) -> tuple[Floats, MapGrid]:
    """Values (rows, columns) of a SpatialGridDataFrame of R, and its cells."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (grid_frame,) = importlib.import_module("rdata").read_rda(str(path)).values()
    cells = grid_frame.grid
    west, south = (float(value) for value in vars(cells)["cellcentre.offset"].values)
    step, _ = (float(value) for value in vars(cells)["cellsize"].values)
    columns, rows = (int(value) for value in vars(cells)["cells.dim"].values)
    values = grid_frame.data.to_numpy(float).reshape(rows, columns)
    west, north = round(west - step / 2), round(south + (rows - 0.5) * step)
    return values, MapGrid(west, north, step, step, columns, rows, "EPSG:32618")


def checkers(grid: MapGrid, side: float = 240.0, cell: float = 5.0) -> Floats:
    """Fields of reflectance 0.1 and 0.4 at 20 degrees from the cells, finely sampled."""
    count = round(grid.columns * grid.step_x / cell)
    y, x = np.indices((count, count)) * cell
    a, b = x * np.cos(20 * deg) + y * np.sin(20 * deg), y * np.cos(20 * deg) - x * np.sin(20 * deg)
    return np.where((a // side + b // side) % 2 == 0, 0.1, 0.4)


def rendered(terrain: Floats, grid: MapGrid, folder: Path, fields: Floats | None) -> Floats:
    """Radiance (rows, columns) on the cells of the map, of numbers with noise."""
    write(folder / "dem.tif", terrain, grid)
    maps: dict[str, Any] = {}
    if fields is not None:
        write(folder / "fields.tif", fields, grid)
        maps = {"maps": (MapFile("fields", "fields.tif", exact=True),)}
    middle = np.array([grid.rows // 2 * grid.columns + grid.columns // 2])
    places = grid.places(slice(0, grid.rows))
    longitude, latitude = (float(values[middle][0]) for values in places)
    low, high = float(terrain.min()), float(terrain.max())
    ground = Terrain(("dem.tif",), sea=low, lowest=low - 1, highest=high + 1, **maps)
    land = Land(
        (Cover(Curve((), (0.25,))),),
        lapse=0.0,
        maps=(ReflectanceMap("fields", 830 * nm),) if maps else (),
    )
    high_above = 100e3 - (low + high) / 2
    pitch, size = 40 * um, grid.columns + 40
    detector = Detector(
        size,
        size,
        pitch,
        1e-3,
        Curve((), (0.6,)),
        full_well=1e6,
        bits=8,
        offset=8,
        pixel_rate=1e9,
        scan=Scan(),
    )
    focal = pitch * high_above / grid.step_x
    # exp(-2 (pi s / 2)^2) of the blur times 2 / pi of the pixel is 0.3 at Nyquist frequency.
    blur = pitch * np.sqrt(-np.log(0.3 * np.pi / 2) * 2) / np.pi
    optics = Optics(focal, focal / 0.02, blur=blur, psf="gaussian")
    band = Curve((774 * nm, 775 * nm, 900 * nm, 901 * nm), (0.0, 1.0, 1.0, 0.0))
    channel = Channel("nir", optics, detector, band)
    plane = Aircraft("2002-11-25T15:37:00", longitude, latitude, 100e3, speed=100.0)
    survey = Survey(
        Imager((channel,)), ground, aircraft=plane, land=land, air=Air(), rays=3, sky_rays=16
    )
    electrons = prepare(survey, channel, folder).electrons
    well = electrons * GAIN * 255 / um
    detector = replace(detector, full_well=well, read_noise=0.8 * well / 255)
    channel = replace(channel, detector=detector)
    survey = replace(survey, camera=Imager((channel,)))
    picture = Picture.blank(size, size)
    setting = render(survey, channel, folder, 1, picture)
    radiance = to_radiance(picture.numbers, calibrate(survey, channel, setting, 1))
    scene = replace(survey, rays=1).scene(channel)
    distance = np.full(radiance.shape, high_above)
    out = np.empty((grid.rows, grid.columns))
    for part in place_cells(scene, folder, grid, distance, grid.step_x, setting.camera):
        out[part.rows] = resample(radiance, part.pixel, "cubic")
    return out


def write(path: Path, values: Floats, grid: MapGrid) -> None:
    """A GeoTIFF of values that fill the cells of a map."""
    import rasterio

    step = grid.step_x * grid.columns / values.shape[1]
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=values.shape[1],
        height=values.shape[0],
        count=1,
        dtype="float32",
        crs=grid.system,
        transform=rasterio.transform.from_origin(grid.west, grid.north, step, step),
    ) as file:
        file.write(values.astype(np.float32), 1)


def noise(image: Floats) -> float:
    """Scatter around planes in the most uniform windows."""
    y, x = (axis.ravel() - WINDOW // 2 for axis in np.indices((WINDOW, WINDOW)))
    planes = np.linalg.qr(np.stack([np.ones(WINDOW**2), x, y], 1))[0]
    windows = np.lib.stride_tricks.sliding_window_view(image, (WINDOW, WINDOW))
    windows = windows.reshape(-1, WINDOW**2)
    rest = windows - windows @ planes @ planes.T
    scatter = np.sqrt((rest**2).sum(1) / (WINDOW**2 - 3))
    return float(np.percentile(scatter, BEST))


def modulation(image: Floats) -> float:
    """Modulation at Nyquist frequency of a Gaussian as sharp as the sharpest edges.

    For a step blurred by a Gaussian of s pixels, the largest difference between two pixels is erf(1
    / (2 sqrt(2) s)).
    """
    sharpest = []
    for axis in (0, 1):
        step = abs(np.diff(image, axis=axis))
        whole = maximum_filter1d(image, 7, axis) - minimum_filter1d(image, 7, axis)
        whole = np.delete(whole, -1, axis)
        part = (step / np.maximum(whole, 1e-9))[whole > np.percentile(whole, EDGES)]
        sharpest.append(np.percentile(part, 95))
    width = 1 / (2 * np.sqrt(2) * erfinv(min(float(np.mean(sharpest)), 0.999)))
    return float(np.exp(-2 * (np.pi * width / 2) ** 2))


def shift(ours: Floats, theirs: Floats) -> tuple[float, float]:
    """Rows and columns by which the real image is displaced from the rendered one: highest
    correlation."""
    flat = [image - gaussian_filter(image, 20) for image in (ours, theirs)]
    y, x = np.indices(ours.shape)
    inner = (slice(6, -6), slice(6, -6))
    steps = np.arange(-4, 4.01, 0.25)
    best = [
        (
            np.corrcoef(
                map_coordinates(flat[1], [y + dy, x + dx], order=1)[inner].ravel(),
                flat[0][inner].ravel(),
            )[0, 1],
            dy,
            dx,
        )
        for dy in steps
        for dx in steps
    ]
    _, down, right = max(best)
    return down, right
