"""Stated uncertainties of Earth products compared with trials that have errors in the products'
assumptions.

Each trial draws true values of all quantities in `Knowledge`: the lamp, stray light, the response,
visibility, the terrain, the pointing. It renders the scene with the true values and the detector's
noise, and computes the product with the assumed values. The product is compared with the radiance
of the true atmosphere and terrain in the assumed band and direction, and with the map of
reflectance at the stated position. Pixels at the edge of the image are left out.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from earth_real import write
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from startrack import deg, nm, um
from startrack.core import Curve
from startrack.detector import Detector, Scan
from startrack.earth.atmosphere import Air
from startrack.earth.geometry import Aircraft, MapFile, Pointing, Terrain
from startrack.earth.imager import (
    Channel,
    Cover,
    Imager,
    Knowledge,
    Land,
    Picture,
    ReflectanceMap,
    Survey,
    render,
)
from startrack.earth.product import (
    MapGrid,
    ProductSettings,
    brightness_temperature,
    calibrate,
    make_product,
)
from startrack.earth.terrain import EQUATORIAL
from startrack.optics import Optics

Floats = NDArray[np.float64]
SIDE, PIXEL = 28, 30.0  # pixel, metre
EDGE = 3  # pixel, width of the edge
KNOWN = Knowledge(
    lamp=0.01,
    straylight=0.005,
    wavelength=0.5 * nm,
    visibility=0.1,
    slope=0.02,
    height=2.0,
    registration=0.3,
    beyond=0.03,
)
LAYERS = "radiance", "reflectance", "surface reflectance", "place"
WARM = "radiance", "brightness temperature", "place"  # layers of a thermal channel


def shares(trials: int, seed: int = 1, thermal: bool = False) -> dict[str, tuple[float, float]]:
    """For each layer, the fractions of pixels within one and two standard deviations of the truth.

    thermal  a channel at 10.8 um instead of 520 nm
    """
    rng = np.random.default_rng(seed)
    near: dict[str, list[Floats]] = {layer: [] for layer in (WARM if thermal else LAYERS)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        believed = scene(folder, rng, thermal)
        picture = Picture.blank(SIDE, SIDE)
        band = render(believed, believed.channels[0], folder, 0, picture).band
        surface, middles = on_map(folder / "land.tif", picture), places(picture)
        for trial in range(trials):
            z = rng.standard_normal(7)
            true = wrong(believed, folder, rng, z, float(surface.mean()))
            layers, doubt, apart = made(
                true, believed, folder, trial + 1, KNOWN.lamp * z[0], KNOWN.straylight * z[1]
            )
            straight = replace(true, camera=believed.camera, pointing=believed.pointing)
            render(straight, straight.channels[0], folder, 0, picture)
            light = picture.terms.total.astype(float)
            if thermal:
                truth = {
                    "radiance": light,
                    "brightness temperature": brightness_temperature(light.ravel(), band).reshape(
                        light.shape
                    ),
                }
            else:
                truth = {
                    "radiance": light,
                    "surface reflectance": surface,
                    "reflectance": layers["reflectance"] * light / layers["radiance"],
                }
            off = {
                name: (layers[name] - true) / doubt[name]["total"] for name, true in truth.items()
            }
            off["place"] = (apart - middles) / doubt["place"]["total"]  # along two axes
            for layer, values in off.items():
                near[layer].append(abs(values[..., EDGE:-EDGE, EDGE:-EDGE]).ravel())
    return {
        layer: (float((np.concatenate(off) < 1).mean()), float((np.concatenate(off) < 2).mean()))
        for layer, off in near.items()
    }


def places(picture: Picture) -> Floats:
    """Places (2, lines, columns) of an image's pixels, metre east and north from the equator."""
    north = picture.latitude * deg
    return EQUATORIAL * np.stack([picture.longitude * deg * np.cos(north.mean()), north])


def scene(folder: Path, rng: np.random.Generator, thermal: bool) -> Survey:
    """Hills and fields that change over some pixels."""
    cells = round(2.4 * SIDE)  # the image with a margin
    grid = MapGrid(500000.0, 5200000.0, PIXEL / 2, PIXEL / 2, cells, cells, "EPSG:32632")
    heights = 400 + 60 * smooth(cells, 20.0, rng)
    write(folder / "dem.tif", heights, grid)
    write(folder / "land.tif", np.clip(0.25 + 0.06 * smooth(cells, 8.0, rng), 0.05, 0.6), grid)
    longitude, latitude = grid.places(slice(0, cells))
    middle = cells // 2 * cells + cells // 2
    detector = Detector(
        SIDE,
        SIDE,
        40 * um,
        1e-3,
        Curve((), (0.6,)),
        full_well=2e5,
        bits=12,
        offset=20,
        read_noise=60.0,
        pixel_rate=1e9,
        scan=Scan(),
    )
    focal = 40 * um * (99.6e3) / PIXEL
    band = Curve((499 * nm, 500 * nm, 540 * nm, 541 * nm), (0.0, 1.0, 1.0, 0.0))
    if thermal:
        band = Curve((10.3 * um, 10.4 * um, 11.2 * um, 11.3 * um), (0.0, 1.0, 1.0, 0.0))
    channel = Channel(
        "thermal" if thermal else "green", Optics(focal, focal / 0.02, blur=10 * um), detector, band
    )
    plane = Aircraft(
        "2026-06-21T09:00:00", float(longitude[middle]), float(latitude[middle]), 100e3, speed=100.0
    )
    land = Land((Cover(Curve((), (0.25,))),), lapse=0.0, maps=(ReflectanceMap("land", 520 * nm),))
    terrain = Terrain(("dem.tif",), sea=400.0, lowest=0.0, highest=1000.0)
    terrain = replace(terrain, maps=(MapFile("land", "land.tif", absent=0.25),))
    return fitted(
        Survey(
            Imager((channel,)),
            terrain,
            aircraft=plane,
            land=land,
            air=Air(visibility=15e3),
            knowledge=KNOWN,
        ),
        folder,
    )


def fitted(survey: Survey, folder: Path) -> Survey:
    """The scene at the middle of its map, with a full well of 1.6 times its mean signal."""
    channel = survey.channels[0]
    picture = Picture.blank(SIDE, SIDE)
    setting = render(survey, channel, folder, 1, picture)
    # The camera looks at the Earth's centre, which is not on the local vertical: the difference is
    # subtracted.
    plane = survey.aircraft
    assert plane
    away = {
        name: 2 * getattr(plane, name) - float(getattr(picture, name).mean()) * deg
        for name in ("longitude", "latitude")
    }
    survey = replace(survey, aircraft=replace(plane, **away))
    well = float(picture.terms.total.mean()) / um * setting.electrons * 1.6
    detector = replace(channel.detector, full_well=well, read_noise=well / 400)
    return replace(survey, camera=Imager((replace(channel, detector=detector),)))


def wrong(survey: Survey, folder: Path, rng: np.random.Generator, z: Floats, mean: float) -> Survey:
    """The true scene: the assumed scene with one draw of all errors."""
    import rasterio

    with rasterio.open(folder / "dem.tif") as file:
        heights, step = file.read(1).astype(float), file.transform.a
        corner = file.transform.c, file.transform.f
    grid = MapGrid(*corner, step, step, heights.shape[1], heights.shape[0], "EPSG:32632")
    # cells: a Gaussian field of this width has slopes of rms 1 / (sqrt(2) width) times its height
    width = 4.0
    rough = smooth(len(heights), width, rng) * KNOWN.slope * np.sqrt(2) * width * step
    write(folder / "true.tif", heights + rough, grid)
    beyond = max(mean + KNOWN.beyond * z[6], 0.0)
    around = MapFile("land", "land.tif", absent=beyond)
    land = replace(survey.land, covers=(Cover(Curve((), (beyond,))),))
    channel = survey.channels[0].shifted(KNOWN.wavelength * z[2])
    pixel = channel.detector.pitch / channel.optics.image_distance
    turned = Pointing(
        roll=KNOWN.registration * z[4] * pixel, pitch=KNOWN.registration * z[5] * pixel
    )
    return replace(
        survey,
        camera=Imager((channel,)),
        pointing=turned,
        air=Air(visibility=15e3 * (1 + KNOWN.visibility * z[3])),
        terrain=replace(survey.terrain, files=("true.tif",), maps=(around,)),
        land=land,
    )


def made(
    true: Survey, believed: Survey, folder: Path, seed: int, lamp: float, stray: float
) -> tuple[dict[str, Floats], dict[str, dict[str, Floats]], Floats]:
    """Layers of the product from a true scene and the assumed inputs, their uncertainties, and true
    places of the pixels, as for `places`."""
    channel, mine = true.channels[0], believed.channels[0]
    picture = Picture.blank(SIDE, SIDE)
    setting = render(true, channel, folder, seed, picture)
    true_places = places(picture)
    frames = calibrate(true, channel, setting, seed)
    numbers = picture.numbers
    numbers = numbers + stray * (numbers.mean() - channel.detector.offset)
    frames = frames._replace(radiance=frames.radiance * (1 + lamp))
    product = make_product(
        believed, mine, folder, numbers, frames, ProductSettings(uncertainty=True)
    )
    return product.image, product.uncertainty, true_places


def smooth(cells: int, width: float, rng: np.random.Generator) -> Floats:
    """A random field of mean zero and rms one, smooth over `width` cells."""
    field = gaussian_filter(rng.standard_normal((cells, cells)), width, mode="wrap")
    return (field - field.mean()) / field.std()


def on_map(path: Path, picture: Picture) -> Floats:
    """Values (lines, columns) of a map at the places of an image's pixels."""
    import rasterio
    from rasterio import warp

    with rasterio.open(path) as file:
        values, place, system = file.read(1).astype(float), file.transform, file.crs
    x, y = warp.transform("EPSG:4326", system, picture.longitude.ravel(), picture.latitude.ravel())
    column = (np.array(x) - place.c) / place.a - 0.5
    row = (np.array(y) - place.f) / place.e - 0.5
    return map_coordinates(values, [row, column], order=1).reshape(picture.longitude.shape)
