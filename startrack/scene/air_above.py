"""DaySky -> photons of the sky above a camera, and transmittance of the air for stars."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, deg
from startrack.io import checked_arrays, shipped
from startrack.scene.day_sky import DaySky, SunPlace
from startrack.scene.photometry import WAVELENGTH

FORMAT = 1  # of the file
EARTH = 6371e3  # metre, mean radius, as the solver has it
STEPS = 400  # of the integral along the line of sight: 0.1 % error in single scattering
FAINT = 1e-12  # 1 / sr, lower limit, so that logarithms are finite
# Fraction of a gas above a height, as for Earth cameras: scale heights of water and of mixed gases,
# and the heights between which ozone lies evenly; metre.
WATER_SCALE, AIR_SCALE, OZONE_FROM, OZONE_TO = 2e3, 8e3, 12e3, 35e3
# Fraction of the gas above the camera that light crosses before, and after, it is scattered:
# scattering is assumed in the middle.
ABOVE_SCATTERING = 0.5
DIFFUSE_MASS = 1.66  # air masses that diffuse light crosses upwards


@dataclass(frozen=True, eq=False)
class SkyTable:
    """Light that reaches a camera from above, in spherical layers over a Lambert surface.

    wavelength  (k,) metre
    height      (h,) metre of the camera above the sea
    mass        (v,) 1, over the cosine of the zenith angle of the line of sight
    sun         (s,) radian, zenith angle of the Sun
    azimuth     (p,) radian, between line of sight and Sun
    multiple    (2, k, h, v, s, p) 1 / sr, multiply scattered light over black ground, over the
                Sun's irradiance; for molecules alone and with the aerosol
    ground      (2, k, h, v, s) 1 / sr, additional light per unit of albedo, without light scattered
                back
    to the ground
    returned    (2, k) 1, spherical albedo of the air from below
    level       (l,) metre, of the extinctions
    molecules   (k, l) 1 / metre
    aerosol     (k, l) 1 / metre
    single      (k,) 1, albedo of single scattering of the aerosol
    angle       (a,) radian, of scattering
    phase       (2, k, a) 1, phase functions of molecules and aerosol, of mean 1
    irradiance  (bins,) photon / s / m^2 of the Sun at one astronomical unit in each spectral bin
    air         (m,) 1, air masses
    gas         (3, bins, m) 1, transmittance of water, mixed gases and ozone of the whole column
    """

    wavelength: Floats
    height: Floats
    mass: Floats
    sun: Floats
    azimuth: Floats
    multiple: Floats
    ground: Floats
    returned: Floats
    level: Floats
    molecules: Floats
    aerosol: Floats
    single: Floats
    angle: Floats
    phase: Floats
    irradiance: Floats
    air: Floats
    gas: Floats


ARRAYS = tuple(part.name for part in fields(SkyTable))


def load_sky(path: Path) -> SkyTable:
    """Read a table of the sky.

    Raises  FileNotFoundError; ValueError if the file is not a table of the sky, or damaged.
    """
    return SkyTable(*checked_arrays(path, "SKY", FORMAT, "a table of the sky", ARRAYS))


def day_light(table: SkyTable, sky: DaySky, sun: SunPlace) -> Floats:
    """(bins,) 1 / sr, light scattered by the air, over the irradiance of a Sun above the horizon.

    Accuracy  as `sky_light`
    """
    once = scattered_once(table, sky, sun)
    multiple, of_ground = scattered_more(table, sky, sun)
    above = above_of(sky.height)
    to_camera = air_mass(math.pi / 2 - sky.elevation)
    from_sun = air_mass(math.pi / 2 - sun.elevation)
    mass = ABOVE_SCATTERING * above * (to_camera + from_sun)
    ground_mass = from_sun + DIFFUSE_MASS * (1 - above) + ABOVE_SCATTERING * above * to_camera
    direct = to_bins(table, once + multiple) * gas_transmittance(table, mass)
    upward = to_bins(table, of_ground) * gas_transmittance(table, ground_mass)
    return np.asarray(direct + upward)


def starlight_through(table: SkyTable, sky: DaySky) -> Floats:
    """(bins,) 1, transmittance of the air above the camera in the line of sight."""
    depth = _column(table, sky) @ _path(table, sky)
    through = np.exp(-np.interp(WAVELENGTH, table.wavelength, depth))
    slant = air_mass(math.pi / 2 - sky.elevation)
    return np.asarray(through * gas_transmittance(table, above_of(sky.height) * slant))


def scattered_light(sky: DaySky, date: str | None = None) -> tuple[Floats, Floats]:
    """Light of the sky without absorption by gases, at the wavelengths of the table.

    Returns  (k,) metre; (k,) 1 / sr, over the Sun's irradiance
    """
    table, sun = sky_table(), sky.sun(date)
    multiple, of_ground = scattered_more(table, sky, sun)
    return table.wavelength, scattered_once(table, sky, sun) + multiple + of_ground


class LitRay(NamedTuple):
    """The line of sight in steps, and the light of a lamp that each step scatters.

    step    (n,) metre
    radius  (n,) metre, from the Earth's centre
    cosine  (n,) of the zenith angle of the Sun
    light   (k, n) 4 pi / sr, light that is scattered once, over the Sun's irradiance
    """

    step: Floats
    radius: Floats
    cosine: Floats
    light: Floats

    def to_sun(self, table: SkyTable, layer: Floats) -> Floats:
        """(k, n) optical depth of layers (k, l - 1) 1 / metre between each step and the Sun."""
        return _depth_to_sun(table, layer, self.radius, self.cosine)


def scattered_once(table: SkyTable, sky: DaySky, sun: SunPlace) -> Floats:
    """(k,) 1 / sr, light scattered once by the air, over the Sun's irradiance.

        L = integral of (m P_m + s a P_a) / 4 pi exp(-depth to the Sun - depth to the camera) ds

    m, a are the extinctions of molecules and aerosol, s the aerosol's albedo, P phase functions at
    the Sun's distance. Straight rays through spherical layers; the ground hides the Sun.
    """
    return np.asarray(sources_of_ray(table, sky, sun).light.sum(1) / (4 * math.pi))


def sources_of_ray(
    table: SkyTable, sky: DaySky, sun: SunPlace, absorber: Floats | None = None
) -> LitRay:
    """The terms of the integral of `scattered_once`.

    absorber  (k, l) 1 / metre, extinction by gases that absorb without scattering
    """
    zenith = math.pi / 2 - sky.elevation
    start = EARTH + sky.height
    end = _reach(start, zenith, EARTH + table.level[-1])
    edges = end * np.linspace(0, 1, STEPS + 1) ** 2  # shorter steps in denser air
    step, place = np.diff(edges), (edges[1:] + edges[:-1]) / 2
    radius = np.sqrt(start**2 + place**2 + 2 * start * place * math.cos(zenith))
    cosine = (start * math.sin(sun.elevation) + place * math.cos(sun.distance)) / radius
    molecules = _each_row(table.molecules, table.level, radius - EARTH)
    aerosol = _each_row(sky.aerosol * table.aerosol, table.level, radius - EARTH)
    extinction, layer = molecules + aerosol, _column(table, sky)
    if absorber is not None:
        extinction += _each_row(absorber, table.level, radius - EARTH)
        layer = layer + (absorber[:, 1:] + absorber[:, :-1]) / 2
    # To the middle of each step.
    depth = np.cumsum(extinction * step, 1) - extinction * step / 2
    sunlight = _depth_to_sun(table, layer, radius, cosine)
    of_molecules, of_aerosol = (
        _each_row(phase, table.angle, sun.distance) for phase in table.phase
    )
    source = molecules * of_molecules[:, None] + (table.single * of_aerosol)[:, None] * aerosol
    return LitRay(step, radius, cosine, source * np.exp(-depth - sunlight) * step)


def _each_row(rows: Floats, nodes: Floats, place: Floats | float) -> Floats:
    """Rows (k, m) of values at nodes (m,), interpolated linearly at places."""
    return np.array([np.interp(place, nodes, row) for row in rows])


def _reach(start: float, zenith: float, top: float) -> float:
    """Metre along a line, at a zenith angle, from a radius to a larger one."""
    return math.sqrt(top**2 - (start * math.sin(zenith)) ** 2) - start * math.cos(zenith)


def _column(table: SkyTable, sky: DaySky) -> Floats:
    """(k, l - 1) 1 / metre, mean extinction of each layer."""
    extinction = table.molecules + sky.aerosol * table.aerosol
    return (extinction[:, 1:] + extinction[:, :-1]) / 2


def _path(table: SkyTable, sky: DaySky) -> Floats:
    """(l - 1,) metre of the line of sight in each layer above the camera."""
    zenith, start = math.pi / 2 - sky.elevation, EARTH + sky.height
    borders = EARTH + np.maximum(table.level, sky.height)
    return np.diff([_reach(start, zenith, float(border)) for border in borders])


def _depth_to_sun(table: SkyTable, layer: Floats, radius: Floats, cosine: Floats) -> Floats:
    """(k, n) optical depth from radii (n,) to the Sun at cosines (n,) of its zenith angle.

    Infinite if the ground is in between.
    """
    nearest = radius * np.sqrt(np.maximum(1 - cosine**2, 0))  # to the Earth's centre
    border = EARTH + table.level
    half = np.sqrt(np.maximum(border**2 - nearest[:, None] ** 2, 0))  # (n, l), from that point
    here = np.sqrt(np.maximum(radius**2 - nearest**2, 0))[:, None]
    upward = np.diff(np.maximum(half, here), axis=1)
    below = np.diff(np.minimum(half, here), axis=1)
    path = upward + np.where(cosine[:, None] < 0, 2 * below, 0)
    hidden = (cosine < 0) & (nearest < EARTH)
    return np.where(hidden, np.inf, layer @ path.T)


def scattered_more(table: SkyTable, sky: DaySky, sun: SunPlace) -> tuple[Floats, Floats]:
    """(k,) 1 / sr each: multiply scattered light, and light of the ground.

    Below the horizontal the Sun counts as at the horizontal.
    """
    axes, place = place_in(table, table.sun, sky, sun)
    multiple, of_ground = [], []  # of molecules alone, and with the aerosol
    for black, ground, returned in zip(table.multiple, table.ground, table.returned, strict=True):
        multiple.append(between(axes, black, place))
        once = between(axes[:3], ground, place[:3])
        of_ground.append(sky.albedo * once / (1 - sky.albedo * returned))

    def mixed(light: list[Floats]) -> Floats:
        return np.maximum((1 - sky.aerosol) * light[0] + sky.aerosol * light[1], 0)

    return mixed(multiple), mixed(of_ground)


def place_in(
    table: SkyTable, zenith: Floats, sky: DaySky, sun: SunPlace
) -> tuple[tuple[Floats, ...], list[float]]:
    """Axes of a table with zenith angles (s,) of the Sun, and the coordinates of a sky in it.

    A Sun below the table's last zenith angle counts at that angle.
    """
    angle = min(max(math.pi / 2 - sun.elevation, 0.0), float(zenith[-1]))
    axes = table.height, np.log(table.mass), zenith, table.azimuth
    mass = 1 / math.sin(sky.elevation)
    return axes, [sky.height, math.log(mass), angle, _azimuth(sky, sun)]


def between(axes: Sequence[Floats], values: Floats, at: Sequence[float]) -> Floats:
    """(k,) values (k, ...) between nodes, by monotone cubic curves through their logarithms."""
    from scipy.interpolate import PchipInterpolator  # 0.1 s; few scenes are below the air

    for axis, place in zip(axes, at, strict=True):
        # The curve in a cell depends on two nodes to each side.
        first = min(max(int(np.searchsorted(axis, place)) - 2, 0), len(axis) - 4)
        near = slice(first, first + 4)
        logs = np.log(np.maximum(values[:, near], FAINT))
        values = np.exp(PchipInterpolator(axis[near], logs, axis=1)(place))
    return values


def _azimuth(sky: DaySky, sun: SunPlace) -> float:
    """Radian between the line of sight and the Sun, about the zenith."""
    level = math.cos(sky.elevation) * math.cos(sun.elevation)
    if level < 1e-12:
        return 0.0
    along = math.cos(sun.distance) - math.sin(sky.elevation) * math.sin(sun.elevation)
    return math.acos(min(max(along / level, -1.0), 1.0))


def to_bins(table: SkyTable, values: Floats) -> Floats:
    """(bins,) from (k,), straight lines in the logarithms of wavelength and value."""
    logs = np.log(np.maximum(values, FAINT))
    return np.asarray(np.exp(np.interp(np.log(WAVELENGTH), np.log(table.wavelength), logs)))


def above_of(height: float) -> Floats:
    """(3,) 1, fractions of water, mixed gases and ozone above a height."""
    ozone = min(max((OZONE_TO - height) / (OZONE_TO - OZONE_FROM), 0.0), 1.0)
    return np.array([math.exp(-height / WATER_SCALE), math.exp(-height / AIR_SCALE), ozone])


def gas_transmittance(table: SkyTable, mass: Floats) -> Floats:
    """(bins,) 1, transmittance of (3,) air masses of water, mixed gases and ozone."""
    through = np.ones(len(WAVELENGTH))
    for rows, of_gas in zip(table.gas, mass, strict=True):
        through *= _each_row(rows, table.air, of_gas)
    return through


def air_mass(zenith: float) -> float:
    """Air masses at sea level; Kasten and Young (1989), Appl. Opt. 28, 4735."""
    angle = min(zenith / deg, 90.0)
    return 1 / (math.cos(angle * deg) + 0.50572 * (96.07995 - angle) ** -1.6364)


@lru_cache(maxsize=1)
def sky_table() -> SkyTable:
    """The shipped table."""
    return load_sky(shipped("atmosphere/sky.fits"))
