"""EarthScene: a camera in flight over terrain, from a scene file; the ground that it sees."""

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from glob import glob
from pathlib import Path
from typing import Annotated

import numpy as np

from startrack import core
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    printed,
)
from startrack.earth.geometry import sight
from startrack.earth.geometry.orbit import Aircraft, Carrier, Orbit, choose_carrier
from startrack.earth.geometry.sight import Elements
from startrack.earth.terrain import (
    EQUATORIAL,
    Array,
    Grid,
    Ground,
    HeightChart,
    Mosaic,
    Pyramid,
    Raster,
    Rays,
    Source,
    fractal,
    read_charts,
    survey,
)
from startrack.space import sun_direction

DETECTORS = ("matrix", "line", "staggered", "tdi")
BATCH = 2**17  # rays at a time, to limit the memory; chosen by hand


class Sensor(Parameters):
    """The detector and lens, as the geometry needs them."""

    detector: str = parameter(
        "matrix, line, staggered or tdi", limit=Range(choices=DETECTORS), default="line"
    )
    columns: int = parameter(
        "pixel, columns or rows of the image", limit=Range(2, 2**16), default=512
    )
    lines: int = parameter("of the image", limit=Range(1, 2**16), default=512)
    focal_length: float = parameter("metre", unit=Unit("m"), limit=POSITIVE, default=1.0)
    pixel_pitch: float = parameter("metre", unit=Unit("m", "um"), limit=POSITIVE, default=10e-6)
    period: Annotated[float, Unit("s", "ms")] | None = parameter(
        "time from line to line; None: square pixels below the satellite",
        limit=POSITIVE,
        default=None,
    )
    stages: int = parameter(
        "rows of a TDI detector; rows between both lines of a staggered detector",
        limit=Range(1, 512),
        default=8,
    )
    rays: int = parameter("rays along each side of a pixel", limit=Range(1, 16), default=1)
    delay: float = parameter(
        "time of the middle line after the orbit's epoch", unit=Unit("s"), limit=FINITE, default=0.0
    )

    @property
    def camera(self) -> core.Camera:
        """Pixel grid of the sensor; the line of a line detector is the middle row."""
        rows = self.lines if self.detector == "matrix" else 2 * self.stages + 1
        width = self.columns // 2 if self.detector == "staggered" else self.columns
        return core.Camera(width, rows, self.focal_length / self.pixel_pitch)

    def elements(self, orbit: Carrier, first: int = 0, count: int = 1) -> Elements:
        """Elements of the given lines of a matrix; for other detectors, elements of each line."""
        middle = self.camera.centre[1]
        if self.detector == "matrix":
            return sight.matrix_elements(self.columns, first, count)
        if self.detector == "staggered":
            pace = self._square(orbit) / self.dating(orbit).period
            upper = middle - self.stages / 2
            return sight.staggered_elements(self.columns, upper, self.stages, lines_a_pixel=pace)
        if self.detector == "tdi":
            return sight.tdi_elements(self.columns, middle, self.stages)
        return sight.line_elements(self.columns, middle)

    def dating(self, orbit: Carrier) -> sight.Dating:
        """Times of lines: the image is taken around the epoch of the orbit plus `delay`."""
        if self.detector == "matrix":
            return sight.Dating(self.delay)
        period = self.period
        if period is None:
            period = self._square(orbit) / (2 if self.detector == "staggered" else 1)
        return sight.Dating(self.delay - 0.5 * (self.lines - 1) * period, period)

    def _square(self, orbit: Carrier) -> float:
        """Time in which the ground below moves by a pixel, second."""
        return self.pixel_pitch / self.focal_length / sight.ground_rate(orbit)


class Fractal(Parameters):
    """Terrain from a seed."""

    longitude: float = parameter(
        "of its middle", unit=Unit("rad", "deg"), limit=Range(-2 * math.pi, 2 * math.pi)
    )
    # Nearer to the poles, cells of equal size are impossible.
    latitude: float = parameter("of its middle", unit=Unit("rad", "deg"), limit=Range(-1.48, 1.48))
    cell: float = parameter("metre", unit=Unit("m"), limit=POSITIVE, default=30.0)
    cells: int = parameter("along each side", limit=Range(2, 2**14), default=1024)
    relief: float = parameter(
        "range of heights, from 0", unit=Unit("m"), limit=POSITIVE, default=2000.0
    )
    roughness: float = parameter("1, lower for rougher terrain", limit=FINITE, default=2.0)
    seed: int = 1

    @lru_cache(maxsize=2)  # noqa: B019 - by value; every image opens its terrain several times
    def source(self) -> Array:
        """Heights of the fractal."""
        step_y = self.cell / EQUATORIAL
        step_x = step_y / math.cos(self.latitude)
        half, count = self.cells / 2, self.cells + 1
        west, north = self.longitude - half * step_x, self.latitude + half * step_y
        heights = fractal(count, count, core.Streams(self.seed, 0), self.relief, self.roughness)
        return Array(Grid(west, north, step_x, step_y, count, count), heights)


class MapFile(Parameters):
    """A map of the ground."""

    name: str = parameter("of the map")
    file: str = parameter("any raster")
    exact: bool = parameter("whether its values are classes", default=False)
    absent: float = parameter("value where the file has no value", default=math.nan)
    band: int = parameter("band of the file, 1 the first", limit=Range(1, 2**16), default=1)


class Terrain(Parameters):
    """Heights and maps of a scene, and the fineness of their use."""

    files: tuple[str, ...] = parameter(
        'rasters of heights, or patterns such as "dem/*.tif"; the finest available raster is used',
        default=(),
    )
    fractal: Fractal | None = parameter(
        "terrain from a seed, instead of or besides files", default=None
    )
    geoid: str | None = parameter(
        "raster of undulations, for heights above the geoid", default=None
    )
    sea: float = parameter("height where no file covers the Earth", unit=Unit("m"), default=0.0)
    holes: float | None = parameter(
        "height of holes inside files; None: a visible hole is refused",
        unit=Unit("m"),
        default=None,
    )
    lowest: float = parameter(
        "above the ellipsoid, between which all heights lie", unit=Unit("m"), default=-500.0
    )
    highest: float = parameter(
        "above the ellipsoid, between which all heights lie", unit=Unit("m"), default=9000.0
    )
    tiles: int = parameter(
        "largest number of tiles in memory, of 512 x 512 cells and 1.4 MB each",
        limit=Range(2, 2**16),
        default=64,
    )
    sharpness: float = parameter("1, as in Pyramid", limit=NON_NEGATIVE, default=1.0)
    maps: tuple[MapFile, ...] = parameter("on the terrain", default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.files and self.fractal is None:
            raise ValueError("files or fractal must be given, got neither")

    def _require_level(self, files: list[Raster]) -> None:
        """Refuse heights above the ellipsoid beside a geoid; warn of heights above one, without."""
        for file in files:
            surface, gravity = file.scaling[3:]
            if surface and self.geoid and not gravity:
                raise Refused(
                    f"terrain.geoid must be left out, as heights of {file.path} are above the "
                    f"ellipsoid of {surface}"
                )
            if gravity and not self.geoid:
                warnings.warn(
                    f"heights of {file.path} are above a level surface ({surface}), but "
                    "terrain.geoid is not given: they count from the ellipsoid, up to 100 m away",
                    stacklevel=3,
                )
                return  # once for all tiles

    def open(self, folder: Path) -> Pyramid:
        """The terrain; files are relative to the folder of the scene file.

        Raises  Refused for a geoid beside heights that are above the ellipsoid already. Warns of
                heights above a geoid that no geoid's grid is given for.
        """
        files = [Raster(path, heights=True) for path in find(folder, self.files)]
        self._require_level(files)
        sources: list[Source] = [*files]
        if self.fractal:
            sources.append(self.fractal.source())
        geoid = Raster(folder / self.geoid, heights=True) if self.geoid else None
        return Pyramid(
            Mosaic(tuple(sources)),
            sea=self.sea,
            geoid=geoid,
            lowest=self.lowest,
            highest=self.highest,
            tiles=self.tiles,
            sharpness=self.sharpness,
            holes=self.holes,
        )

    def charts(self, folder: Path) -> dict[str, HeightChart]:
        """The maps by name."""
        charts = {}
        for entry in self.maps:
            source = Raster(folder / entry.file, entry.band, entry.exact)
            charts[entry.name] = HeightChart(Mosaic((source,)), entry.exact, entry.absent)
        return charts


class EarthScene(Parameters):
    """A camera in flight over terrain."""

    terrain: Terrain
    sensor: Sensor = field(default_factory=Sensor)
    orbit: Orbit | None = None
    tle: tuple[str, ...] = parameter(
        "two-line elements of a satellite, instead of an orbit", default=()
    )
    aircraft: Aircraft | None = parameter("instead of both", default=None)
    pointing: sight.Pointing = field(default_factory=sight.Pointing)
    sky_rays: int = parameter(
        "rays from each point that sample the sky; 0: none", limit=Range(0, 2**12), default=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.carrier

    @property
    def carrier(self) -> Carrier:
        """Orbit, two-line elements or aircraft."""
        return choose_carrier(self.orbit, self.tle, self.aircraft)


def find(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    """The files that match patterns, each once, sorted by name."""
    files: dict[Path, None] = {}
    for pattern in patterns:
        paths = sorted(glob(str(folder / pattern), recursive=True))
        if not paths:
            raise FileNotFoundError(f"{folder / pattern} must name files, but there are none")
        files.update(dict.fromkeys(map(Path, paths)))
    return list(files)


@printed
@dataclass(frozen=True, eq=False)
class Strip:
    """Some lines of an image and the ground in them.

    first   number of the strip's first line
    shape   lines, columns, rays of a pixel: order of the ground's rays
    ground  ground of all rays
    """

    first: int
    shape: tuple[int, int, int]
    ground: Ground

    def mean(self, values: Floats) -> Floats:
        """Mean (lines, columns) over the rays of each pixel that have a value; NaN without any."""
        rays = np.asarray(values, float).reshape(self.shape)
        finite = np.isfinite(rays)
        with np.errstate(invalid="ignore"):
            return np.where(finite, rays, 0).sum(axis=2) / finite.sum(axis=2)


def ground_finder(
    scene: EarthScene, folder: Path, terrain: Pyramid, sky_rays: int = 0
) -> Callable[[Rays], Ground]:
    """Finder of the ground that rays meet in a scene, under its Sun and with its maps."""
    charts, cell = scene.terrain.charts(folder), terrain.terrain.grid.step_y
    sun = sun_direction(scene.carrier.epoch, scene.sensor.delay)
    return lambda rays: read_charts(survey(terrain, rays, sun, sky_rays), charts, cell)


def observe_earth(
    scene: EarthScene,
    folder: Path,
    turn: sight.Jitter | None = None,
    camera: core.Camera | None = None,
    terrain: Pyramid | None = None,
) -> Iterator[Strip]:
    """Ground in all pixels of a scene, some lines at a time.

    folder   folder of the files
    turn     attitude jitter, as in `sight`
    camera   of the sensor's pixels, with its distortion; None: the sensor's own, without
    terrain  terrain of the scene, with the tiles read so far; None: opened here
    """
    sensor, orbit = scene.sensor, scene.carrier
    seen = ground_finder(scene, folder, terrain or scene.terrain.open(folder), scene.sky_rays)
    step = max(1, BATCH // (sensor.elements(orbit).x.size * sensor.rays**2))
    for first in range(0, sensor.lines, step):
        count = min(step, sensor.lines - first)
        lines = np.arange(first, first + count, dtype=np.float64)
        rays = sight.scan_lines(
            camera or sensor.camera,
            sensor.elements(orbit, first, count),
            lines[:1] if sensor.detector == "matrix" else lines,
            sensor.dating(orbit),
            orbit,
            scene.pointing,
            turn,
            sensor.rays,
        )
        shape = (count, sensor.columns, len(rays) // (count * sensor.columns))
        yield Strip(first, shape, seen(rays))
