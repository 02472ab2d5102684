"""EarthScene: a camera in flight over terrain, as a scene file gives it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from glob import glob
from pathlib import Path
from typing import Annotated

from startrack.core import (
    Camera,
    Streams,
    Unit,
    finite,
    non_negative,
    one_of,
    positive,
    whole,
    within,
)
from startrack.earth.geometry.orbit import Aircraft, Carrier, Orbit, choose_carrier
from startrack.earth.geometry.sensor import (
    Dating,
    Elements,
    line_elements,
    matrix_elements,
    staggered_elements,
    tdi_elements,
)
from startrack.earth.geometry.sight import Pointing, ground_rate
from startrack.earth.terrain import (
    EQUATORIAL,
    Array,
    Chart,
    Grid,
    Mosaic,
    Pyramid,
    Raster,
    Source,
    fractal,
)

DETECTORS = ("matrix", "line", "staggered", "tdi")


@dataclass(frozen=True)
class Sensor:
    """The detector and lens, as the geometry needs them.

    detector      matrix, line, staggered or tdi
    columns       pixel, of the image
    lines         of the image
    focal_length  metre
    pixel_pitch   metre
    period        second from line to line; None for square pixels below the satellite
    stages        rows of a TDI detector, or rows between the two of a staggered one
    rays          along each side of a pixel
    delay         second after the orbit's epoch at which the middle line is taken
    """

    detector: str = "line"
    columns: int = 512
    lines: int = 512
    focal_length: Annotated[float, Unit("m")] = 1.0
    pixel_pitch: Annotated[float, Unit("m", "um")] = 10e-6
    period: Annotated[float, Unit("s", "ms")] | None = None
    stages: int = 8
    rays: int = 1
    delay: Annotated[float, Unit("s")] = 0.0

    def __post_init__(self) -> None:
        finite(delay=self.delay)
        one_of(DETECTORS, detector=self.detector)
        whole(2, 2**16, columns=self.columns)
        whole(1, 2**16, lines=self.lines)
        positive(focal_length=self.focal_length, pixel_pitch=self.pixel_pitch)
        if self.period is not None:
            positive(period=self.period)
        whole(1, 512, stages=self.stages)
        whole(1, 16, rays=self.rays)

    @property
    def camera(self) -> Camera:
        """Its pixel grid; a line detector has its line in the middle row."""
        rows = self.lines if self.detector == "matrix" else 2 * self.stages + 1
        width = self.columns // 2 if self.detector == "staggered" else self.columns
        return Camera(width, rows, self.focal_length / self.pixel_pitch)

    def elements(self, orbit: Carrier) -> list[Elements]:
        """Elements of each line of a matrix; of other detectors one for all lines."""
        middle = self.camera.centre[1]
        if self.detector == "matrix":
            return matrix_elements(self.columns, self.lines)
        if self.detector == "staggered":
            pace = self._square(orbit) / self.dating(orbit).period
            first = middle - self.stages / 2
            return [staggered_elements(self.columns, first, self.stages, lines_a_pixel=pace)]
        if self.detector == "tdi":
            return [tdi_elements(self.columns, middle, self.stages)]
        return [line_elements(self.columns, middle)]

    def dating(self, orbit: Carrier) -> Dating:
        """The image is taken around the epoch of the orbit, or `delay` after it."""
        if self.detector == "matrix":
            return Dating(self.delay)
        period = self.period
        if period is None:
            period = self._square(orbit) / (2 if self.detector == "staggered" else 1)
        return Dating(self.delay - 0.5 * (self.lines - 1) * period, period)

    def _square(self, orbit: Carrier) -> float:
        """Second in which the ground below moves by a pixel."""
        return self.pixel_pitch / self.focal_length / ground_rate(orbit)


@dataclass(frozen=True)
class Fractal:
    """Terrain from a seed.

    longitude, latitude  radian, of its middle
    cell                 metre
    cells                along each side
    relief               metre from the lowest height, at 0, to the highest
    roughness            1, lower for rougher terrain
    """

    longitude: Annotated[float, Unit("rad", "deg")]
    latitude: Annotated[float, Unit("rad", "deg")]
    cell: Annotated[float, Unit("m")] = 30.0
    cells: int = 1024
    relief: Annotated[float, Unit("m")] = 2000.0
    roughness: float = 2.0
    seed: int = 1

    def __post_init__(self) -> None:
        within(-2 * math.pi, 2 * math.pi, longitude=self.longitude)
        within(
            -1.48, 1.48, latitude=self.latitude
        )  # nearer to the poles, cells of one size are impossible
        positive(cell=self.cell, relief=self.relief)
        whole(2, 2**14, cells=self.cells)
        finite(roughness=self.roughness)

    def source(self) -> Array:
        """Its heights."""
        step_y = self.cell / EQUATORIAL
        step_x = step_y / math.cos(self.latitude)
        half = self.cells / 2
        count = self.cells + 1
        grid = Grid(
            self.longitude - half * step_x,
            self.latitude + half * step_y,
            step_x,
            step_y,
            count,
            count,
        )
        streams = Streams(self.seed, 0)
        return Array(grid, fractal(count, count, streams, self.relief, self.roughness))


@dataclass(frozen=True)
class MapFile:
    """A map of the ground.

    name    of the map
    file    any raster
    band    of it, 1 the first
    exact   whether its values are classes
    absent  value where the file has none
    """

    name: str
    file: str
    exact: bool = False
    absent: float = math.nan
    band: int = 1

    def __post_init__(self) -> None:
        whole(1, 2**16, band=self.band)


@dataclass(frozen=True)
class Terrain:
    """Heights and maps of a scene, and how finely they are used.

    files            rasters of heights, or patterns such as "dem/*.tif"; the finest is used
    fractal          terrain from a seed, instead of or besides them
    geoid            raster of undulations, where the heights are above the geoid
    sea              metre, height where there are no data
    lowest, highest  metre above the ellipsoid, between which all heights lie
    tiles            of 512 x 512 cells that fit into memory, 1.4 MB each
    sharpness        1, as in Pyramid
    maps             on the terrain
    """

    files: tuple[str, ...] = ()
    fractal: Fractal | None = None
    geoid: str | None = None
    sea: Annotated[float, Unit("m")] = 0.0
    lowest: Annotated[float, Unit("m")] = -500.0
    highest: Annotated[float, Unit("m")] = 9000.0
    tiles: int = 64
    sharpness: float = 1.0
    maps: tuple[MapFile, ...] = ()

    def __post_init__(self) -> None:
        if not self.files and self.fractal is None:
            raise ValueError("files or fractal must be given, got neither")
        whole(2, 2**16, tiles=self.tiles)
        non_negative(sharpness=self.sharpness)

    def open(self, folder: Path) -> Pyramid:
        """The terrain; files are relative to the folder of the scene file."""
        sources: list[Source] = [Raster(path) for path in find(folder, self.files)]
        if self.fractal:
            sources.append(self.fractal.source())
        geoid = Raster(folder / self.geoid) if self.geoid else None
        return Pyramid(
            Mosaic(tuple(sources)), self.sea, geoid, self.lowest, self.highest, self.tiles,
            self.sharpness,
        )  # fmt: skip

    def charts(self, folder: Path) -> dict[str, Chart]:
        """The maps by their names."""
        return {
            one.name: Chart(
                Mosaic((Raster(folder / one.file, one.band, one.exact),)), one.exact, one.absent
            )
            for one in self.maps
        }


@dataclass(frozen=True)
class EarthScene:
    """A camera in flight over terrain.

    tle       two lines of a satellite, instead of an orbit
    aircraft  instead of both
    sky_rays  rays from each point that sample the sky; 0 for none
    """

    terrain: Terrain
    sensor: Sensor = field(default_factory=Sensor)
    orbit: Orbit | None = None
    tle: tuple[str, ...] = ()
    aircraft: Aircraft | None = None
    pointing: Pointing = field(default_factory=Pointing)
    sky_rays: int = 0

    def __post_init__(self) -> None:
        whole(0, 2**12, sky_rays=self.sky_rays)
        _ = self.carrier

    @property
    def carrier(self) -> Carrier:
        """Orbit, two-line elements or aircraft."""
        return choose_carrier(self.orbit, self.tle, self.aircraft)


def find(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    """The files that match patterns, each once, in the order of their names."""
    found: dict[Path, None] = {}
    for pattern in patterns:
        paths = sorted(glob(str(folder / pattern), recursive=True))
        if not paths:
            raise FileNotFoundError(f"{folder / pattern} must name files, but there are none")
        found.update(dict.fromkeys(map(Path, paths)))
    return list(found)
