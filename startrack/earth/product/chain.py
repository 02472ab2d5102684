"""A product of a channel from its raw image and its calibration frames."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from startrack.core import (
    POSITIVE,
    Flags,
    Floats,
    Parameters,
    Range,
    Unit,
    parameter,
    printed,
    require_memory,
)
from startrack.earth.geometry import EarthScene, observe_earth
from startrack.earth.imager import (
    Channel,
    Setting,
    Survey,
    lines_apart,
    open_sheets,
    prepare,
    restoration_of,
)
from startrack.earth.product import ortho, retrieval
from startrack.earth.product.uncertainty import contributors
from startrack.earth.terrain import Ground, joined

PIXEL_BYTES = 400  # bytes per pixel for geometry and layers
SPREAD = 3  # pixel, distance over which a lens spreads relevant light; chosen by hand
UNITS = {
    "radiance": "W m-2 sr-1 um-1",
    "reflectance": "1",
    "surface reflectance": "1",
    "brightness temperature": "K",
}


class ProductSettings(Parameters):
    """Settings of a product on a map."""

    projection: str = parameter(limit=Range(choices=ortho.PROJECTIONS), default="utm")
    cell: float | None = parameter(
        "cell size; None: pixel size in the middle of the image",
        unit=Unit("m"),
        limit=POSITIVE,
        default=None,
    )
    resampling: str = parameter(limit=Range(choices=tuple(ortho.RESAMPLING)), default="bilinear")
    uncertainty: bool = parameter(
        "whether to compute the uncertainty of each pixel, by contributors", default=False
    )
    restore: float | None = parameter(
        "design signal-to-noise ratio of the Wiener filter that raises the modulation; None: the "
        "channel's",
        limit=POSITIVE,
        default=None,
    )


STANDARD = ProductSettings()


@printed
class Product(NamedTuple):
    """Layers of one channel, in image and map.

    image         (lines, columns) by name: radiance in watt / m^2 / sr / um; reflectance at the top
                  of the atmosphere and of the surface, or brightness temperature in kelvin
    saturated     (lines, columns)
    grid          of the map
    layers        (rows, columns) by name, likewise; NaN without data
    quality       (rows, columns) bits of QUALITY
    surroundings  1, retrieved mean reflectance; NaN for thermal radiance
    uncertainty   for each layer, and for `place` in metre: (lines, columns) by contributor, one
                  standard deviation each; empty without `uncertainty`
    doubt         the same on the map, by "layer: contributor"
    """

    image: dict[str, Floats]
    saturated: Flags
    grid: ortho.MapGrid
    layers: dict[str, Floats]
    quality: ortho.Bytes
    surroundings: float
    uncertainty: dict[str, dict[str, Floats]]
    doubt: dict[str, Floats]


def make_product(
    survey: Survey,
    channel: Channel,
    folder: Path,
    numbers: NDArray[np.integer],
    calibration: retrieval.RadiometricCalibration,
    settings: ProductSettings = STANDARD,
    advance: Callable[[float], None] = lambda part: None,
) -> Product:
    """Radiance, reflectance or temperature in the image, and on a map of the terrain.

    The scene file gives the geometry. Its land is not used; places of its clouds are used only for
    the quality.

    folder   folder of relative file names
    advance  called with fractions of the work
    Raises   ValueError if frames do not fit, or no ground is seen; ImportError without rasterio.
    Accuracy model: flight, pointing and terrain are known exactly; drift and jitter are unknown. A
             pixel's ground is the point on its central ray. Distortion and keystone are known. With
             smile, reflectance uses the band at the middle of the line.
    """
    lines, columns = numbers.shape
    require_memory(PIXEL_BYTES * lines * columns, f"a product of {columns} x {lines} pixels")
    survey = replace(survey, rays=1, surroundings=survey.surroundings or 0.0)
    setting = prepare(survey, channel, folder)
    radiance = retrieval.to_radiance(numbers, calibration)
    amplified = 1.0
    if wanted := settings.restore or channel.restore:
        between = lines_apart(channel, setting)
        restoration = restoration_of(channel, setting.psf, setting.smear, between, wanted)
        radiance, amplified = restoration.applied(radiance), restoration.noise
    saturated = numbers >= calibration.saturation
    scene = survey.scene(channel)
    grounds = _ground_of_lines(scene, folder, setting, lambda done: advance(0.3 * done / lines))
    ground = joined(grounds)
    if not ground.hit.any():
        raise ValueError("an image must show ground for a map, but shows only sky")
    distance = ground.distance.reshape(lines, columns)
    size = float(np.nanmedian(distance)) * channel.detector.pitch / channel.optics.image_distance
    image, here = _layers(radiance, grounds, setting, size)
    causes: dict[str, dict[str, Floats]] = {}
    if settings.uncertainty:
        causes = contributors(image, numbers, ground, calibration, here, survey, channel, amplified)
    doubts = {
        f"{name}: {cause}": values for name, own in causes.items() for cause, values in own.items()
    }
    cell = settings.cell or float(f"{size / (channel.columns / channel.detector.columns):.2g}")
    grid = ortho.grid_of(ground.longitude, ground.latitude, settings.projection, cell)
    require_memory(40 * grid.rows * grid.columns, f"a map of {grid.columns} x {grid.rows} cells")
    cells = ortho.place_cells(
        scene, folder, grid, distance, size, setting.camera, open_sheets(survey.clouds, folder)
    )
    layers, quality = _on_map(
        image | doubts, saturated, grid, cells, settings, lambda part: advance(0.7 * part)
    )
    mapped, doubt = ({name: layers[name] for name in own} for own in (image, doubts))
    around = math.nan if retrieval.is_thermal(setting.band) else here.surroundings
    return Product(
        image=image,
        saturated=saturated,
        grid=grid,
        layers=mapped,
        quality=quality,
        surroundings=around,
        uncertainty=causes,
        doubt=doubt,
    )


def _ground_of_lines(
    scene: EarthScene, folder: Path, setting: Setting, advance: Callable[[int], None]
) -> list[Ground]:
    """The ground on the central rays of pixels, for successive parts of the image.

    advance  called with the number of lines of each part
    """
    grounds = []
    for strip in observe_earth(scene, folder, None, setting.camera, setting.terrain):
        which = np.arange(len(strip.ground)).reshape(strip.shape)[..., strip.shape[2] // 2]
        grounds.append(strip.ground[which.ravel()])
        advance(strip.shape[0])
    return grounds


def _on_map(
    image: Mapping[str, Floats],
    saturated: Flags,
    grid: ortho.MapGrid,
    cells: Iterable[ortho.Part],
    settings: ProductSettings,
    advance: Callable[[float], None],
) -> tuple[dict[str, Floats], ortho.Bytes]:
    """Layers of the image resampled to the cells of a map, and the quality of each cell.

    cells    places of cells in the image, for successive rows of the map
    advance  called with the fraction of the map of each part
    """
    layers = {name: np.full((grid.rows, grid.columns), math.nan) for name in image}
    quality = np.zeros((grid.rows, grid.columns), np.uint8)
    for part in cells:
        bits = part.quality | np.where(ortho.touched(saturated, part.pixel), ortho.SATURATED, 0)
        for name, values in image.items():
            resampled = ortho.resample(values, part.pixel, settings.resampling)
            layers[name][part.rows] = np.where(bits & ortho.NO_DATA, math.nan, resampled)
        lost = np.isnan(layers["radiance"][part.rows])
        quality[part.rows] = np.where(lost, ortho.NO_DATA, bits)
        advance((part.rows.stop - part.rows.start) / grid.rows)
    return layers, quality


def _layers(
    radiance: Floats, grounds: list[Ground], setting: Setting, pixel: float
) -> tuple[dict[str, Floats], Setting]:
    """Layers (lines, columns) in the image, and the setting with the surroundings of each pixel."""
    ends = np.cumsum([len(ground) for ground in grounds])[:-1]
    parts = np.split(radiance.ravel(), ends)
    around = retrieval.mean_reflectance(parts, grounds, setting)
    here = setting._replace(surroundings=0.0 if math.isnan(around) else around)
    if not math.isnan(around):
        here = retrieval.settled(radiance.ravel(), joined(grounds), pixel, here)
    retrievals = [
        retrieval.retrieve(part, ground, here) for part, ground in zip(parts, grounds, strict=True)
    ]
    image = {"radiance": radiance}
    for name in retrievals[0]:
        image[name] = np.concatenate([part[name] for part in retrievals]).reshape(radiance.shape)
    return image, here


def against_truth(product: Product, truth: Floats) -> tuple[float, float]:
    """Relative error of the image's mean radiance, and relative rms of the differences.

    truth  (lines, columns) watt / m^2 / sr / um, before the lens; the rms includes blurred edges
    Saturated pixels are left out, and so are the pixels around them, into which the lens spreads
    light.
    """
    radiance = product.image["radiance"]
    near = maximum_filter(product.saturated, 2 * SPREAD + 1)
    good = np.isfinite(radiance) & ~near & (truth > 0)
    if not good.any():
        return math.nan, math.nan
    mean = float(truth[good].mean())
    error = radiance[good] - truth[good]
    return float(error.mean()) / mean, float(np.sqrt((error**2).mean())) / mean
