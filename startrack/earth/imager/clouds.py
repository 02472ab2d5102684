"""Cloud layers of a scene, and their optical depth over the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from startrack import core
from startrack.core import (
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Parameters,
    Range,
    Unit,
    parameter,
    printed,
)
from startrack.earth.imager.land import TEXELS, on_texture
from startrack.earth.terrain import EQUATORIAL, HeightChart, Mosaic, Raster, fractal, geodetic, up
from startrack.space import standard_temperature

ROUGHNESS = 4 / 3  # spectral exponent: a power spectrum of |k|^(-5/3) along a line, as for clouds
GRAZING = 0.02  # least cosine of the zenith angle of a path through a layer; chosen by hand
STEPS = 4  # steps of Newton's method to the height of a layer; the start is within metres

# 1 - albedo of single scattering: ice of 30 um by Ebert and Curry (1992), J. Geophys. Res. 97,
# 3831, water drops of 10 um by Slingo (1989), J. Atmos. Sci. 46, 1419, four bands each; beyond 4
# um 1 - absorption over extinction, of ice 0.005 + 1 / 30 and of water 0.0904 square metre / gram,
# with the coefficients of the Community Atmosphere Model.
EDGES = (0.2, 0.69, 1.19, 2.38, 4.0, 60.0)  # um
ALBEDOS = {
    "ice": (0.99999, 0.99947, 0.9564, 0.5328, 0.546),
    "water": (1.0, 0.99977, 0.9871, 0.7234, 0.431),
}


class CloudLayer(Parameters):
    """A thin sheet of cloud at one height."""

    height: float = parameter(
        "height above the ellipsoid; higher terrain stands out of the layer",
        unit=Unit("m", "km"),
        limit=Range(0, 30e3),
    )
    optical_depth: float = parameter(
        "1, vertical optical depth, the same at all wavelengths; the mean inside generated "
        "clouds; a factor for the values of a file",
        limit=NON_NEGATIVE,
        default=1.0,
    )
    file: str = parameter(
        "raster of optical depth in any projection, relative to the scene file; no cloud without "
        "a value",
        default="",
    )
    band: int = parameter("band of the file, 1 the first", limit=Range(1, 2**16), default=1)
    cover: float | None = parameter(
        "1, fraction of the sky under generated clouds; None: a uniform layer or a file",
        limit=Range(0.001, 1),
        default=None,
    )
    cell: float = parameter(
        "smallest detail of generated clouds; the field has a period of 1024 details",
        unit=Unit("m"),
        limit=POSITIVE,
        default=100.0,
    )
    seed: int = parameter("of generated clouds", limit=Range(0, 2**31), default=1)
    particles: str = parameter(
        "ice or water, for the single-scattering albedo",
        limit=Range(choices=tuple(ALBEDOS)),
        default="ice",
    )
    albedo: core.Curve | None = parameter("1 over wavelength, instead", default=None)
    asymmetry: float = parameter(
        "1, mean cosine of the scattering angle", limit=Range(-0.99, 0.99), default=0.85
    )
    temperature: float | None = parameter(
        "kelvin; None: temperature of the US Standard Atmosphere at the layer's height",
        unit=Unit("K", absolute=True),
        limit=Range(50, 400),
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.cover is not None and self.file:
            raise ValueError("cover must be left out if file is given, which sets the clouds")

    @property
    def kelvin(self) -> float:
        """Temperature of the layer, kelvin."""
        if self.temperature is not None:
            return self.temperature
        return standard_temperature(self.height)

    @property
    def spectrum(self) -> core.Curve:
        """Single-scattering albedo over wavelength."""
        if self.albedo is not None:
            return self.albedo
        nodes = [end for low, high in pairwise(EDGES) for end in (low, high - 1e-6)]
        values = [value for value in ALBEDOS[self.particles] for _ in range(2)]
        return core.Curve(tuple(node * core.um for node in nodes), tuple(values))

    def open(self, folder: Path) -> Sheet:
        """The layer with its field of optical depth; the file is relative to a folder.

        Raises  as Raster.
        """
        if self.file:
            mosaic = Mosaic((Raster(folder / self.file, self.band),))
            return Sheet(
                self, partial(_mapped, HeightChart(mosaic, absent=0.0), self.optical_depth)
            )
        if self.cover is None:
            return Sheet(self, lambda longitude, _: np.full(len(longitude), self.optical_depth))
        return Sheet(self, partial(_generated, self, _clouds(self.seed, self.cover)))


class CloudField(Protocol):
    """Optical depth over the Earth."""

    def __call__(self, longitude: Floats, latitude: Floats, /) -> Floats:
        """Optical depth (n,) at (n,) radian."""
        ...


def _mapped(chart: HeightChart, factor: float, longitude: Floats, latitude: Floats) -> Floats:
    depth = chart.at(longitude, latitude, np.full(len(longitude), chart.mosaic.grid.step_y))
    return np.maximum(depth * factor, 0.0)


def _generated(layer: CloudLayer, texels: Floats, longitude: Floats, latitude: Floats) -> Floats:
    """Optical depth of generated clouds, linear between texels."""
    x, y = on_texture(longitude, latitude, layer.cell)
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    u, v = x - i, y - j
    depth = np.zeros(len(x))
    for down, across, weight in (
        (0, 0, (1 - v) * (1 - u)),
        (0, 1, (1 - v) * u),
        (1, 0, v * (1 - u)),
        (1, 1, v * u),
    ):
        depth += weight * texels[(j + down) % TEXELS, (i + across) % TEXELS]
    return depth * layer.optical_depth


@lru_cache(maxsize=4)
def _clouds(seed: int, cover: float) -> Floats:
    """Optical depth of generated clouds, of mean 1 inside them; clouds are the highest part of a
    fractal."""
    values = fractal(TEXELS, TEXELS, core.Streams(seed, 2), 1.0, ROUGHNESS).astype(np.float64)
    above = np.maximum(values - np.quantile(values, 1 - cover), 0.0)
    return above / above[above > 0].mean()


@dataclass(frozen=True, eq=False)
class Sheet:
    """A cloud layer with its field of optical depth."""

    layer: CloudLayer
    field: CloudField

    def cross(self, point: Floats, direction: Floats) -> Crossing:
        """Points where straight paths leave the layer, and its optical depth there.

        point      (n, 3) metre, Earth-fixed, start of the paths
        direction  (n, 3) or (3,) unit vectors
        Returns    Crossing; optical depth 0 where a path begins above the layer or leads down
        """
        longitude, latitude, height = geodetic(point)
        rise = (up(longitude, latitude) * direction).sum(-1)
        below = (height < self.layer.height) & (rise > 0)
        radius, slope = EQUATORIAL + height, np.maximum(rise, GRAZING)
        climb = np.maximum(self.layer.height - height, 0.0)
        distance = np.sqrt((radius * slope) ** 2 + climb * (2 * radius + climb)) - radius * slope
        for _ in range(STEPS):
            there = point + distance[:, None] * direction
            longitude, latitude, height = geodetic(there)
            zenith = up(longitude, latitude)
            cosine = np.maximum((zenith * direction).sum(-1), GRAZING)
            distance = np.maximum(distance + (self.layer.height - height) / cosine, 0.0)
        depth = np.zeros(len(point))
        depth[below] = self.field(longitude[below], latitude[below])
        return Crossing(there, longitude, latitude, cosine, distance, depth)


@printed
class Crossing(NamedTuple):
    """Crossing of n paths with a layer.

    point                (n, 3) metre, Earth-fixed
    longitude, latitude  (n,) radian
    cosine               (n,) 1, cosine of the path's zenith angle there
    distance             (n,) metre from the start of the path
    depth                (n,) 1, vertical optical depth
    """

    point: Floats
    longitude: Floats
    latitude: Floats
    cosine: Floats
    distance: Floats
    depth: Floats


def open_sheets(layers: Sequence[CloudLayer], folder: Path) -> tuple[Sheet, ...]:
    """The layers with their fields, the lowest first."""
    return tuple(layer.open(folder) for layer in sorted(layers, key=lambda layer: layer.height))
