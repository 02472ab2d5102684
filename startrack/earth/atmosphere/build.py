"""Air -> AirTable, through sasktran2 and pvlib: the first of the two steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, deg, nm
from startrack.earth.atmosphere.gases import GASES, sunlight, transmittance
from startrack.earth.atmosphere.solver import TOP, solve_radiance
from startrack.earth.atmosphere.table import Air, AirTable

ALBEDOS = (0.25, 0.75)  # besides black: two that tell the ground's two numbers
REFERENCE_SUN = 0.5371  # cosine, away from the ordinates of any solver


class Grid(NamedTuple):
    """Nodes of a table; see AirTable for their units."""

    wavelength: Floats
    height: Floats
    altitude: Floats
    sensor: Floats
    sun: Floats
    azimuth: Floats


SHIPPED = Grid(
    np.array([350.0, 375, 400, 430, 460, 500, 550, 600, 670, 750, 850, 1e3, 1300, 1700, 2500, 4e3])
    * nm,
    np.array([0.0, 1500.0, 4000.0, 9000.0]),
    np.array([2e3, 5e3, 15e3, TOP]),
    np.array([0.0, 10, 20, 30, 40, 50, 60, 67, 74, 80]) * deg,
    np.array([0.0, 10, 20, 30, 40, 50, 60, 67, 74, 80]) * deg,
    np.array([0.0, 10, 25, 45, 70, 95, 120, 145, 165, 180]) * deg,
)
SPECTRUM: Floats = np.concatenate([np.arange(350, 1000, 1.0), np.arange(1000, 4001, 5.0)]) * nm
MASS: Floats = np.array([0.0, 0.25, 0.5, 1, 1.5, 2, 2.5, 3, 4, 5, 7, 9, 12])


def build(
    air: Air,
    grid: Grid = SHIPPED,
    streams: int = 8,
    polarised: bool = True,
    progress: Callable[[float], None] | None = None,
) -> AirTable:
    """Solve the radiative transfer at every node.

    Over a Lambert ground of albedo rho, with g what one unit of it would add,

        L(rho) = L(0) + rho g / (1 - rho S),   g = sun T(sun) T'(sensor) / pi,

    so that three albedos at one place of the Sun give the spherical albedo S and, by reciprocity
    (T' to space is T), all transmittances T. They are direct plus diffuse, and the direct part
    is the exponential of the optical depth.

    progress  called with the fraction that is done
    Returns   AirTable, in double precision
    Raises    as `radiance`
    Accuracy  numerical: 8 streams with single scattering exact stay within 3e-3 of 16 in radiance.
    """
    shape = tuple(len(axis) for axis in grid)
    path = np.empty(shape)
    beam, skylight = np.empty((2, shape[0], shape[1], shape[4]))
    seen, around = np.empty((2, *shape[:4]))
    backscatter = np.empty(shape[:2])
    options = streams, polarised
    for h, ground in enumerate(grid.height):
        total, s, depth, above = _ground(air, grid, ground, *options)
        backscatter[:, h] = s
        slant = np.cos(grid.sensor)
        for a in range(len(grid.altitude)):
            straight = np.exp(-(depth - above[a])[:, None] / slant)
            seen[:, h, a], around[:, h, a] = straight, total[0][:, a] - straight
        cosine = np.cos(grid.sun)
        beam[:, h] = np.exp(-depth[:, None] / cosine)
        skylight[:, h] = cosine * (total[1] - beam[:, h])
        rays = [
            (math.cos(zenith), math.pi - azimuth, min(ground + altitude, TOP))
            for altitude in grid.altitude
            for zenith in grid.sensor
            for azimuth in grid.azimuth
        ]
        for i, sun in enumerate(grid.sun):
            black = solve_radiance(air, grid.wavelength, ground, _off(sun), rays, (0.0,), *options)[
                0
            ][0]
            path[:, h, :, :, i] = black.reshape(shape[0], shape[2], shape[3], shape[5])
            if progress:
                progress((h * shape[4] + i + 1) / (shape[1] * shape[4]))
    gas = np.stack([transmittance(gas, SPECTRUM, MASS, air.water, air.ozone) for gas in GASES])
    return AirTable(
        air,
        *grid,
        path,
        beam,
        skylight,
        seen,
        around,
        backscatter,
        SPECTRUM,
        sunlight(SPECTRUM),
        MASS,
        gas,
    )


def _ground(
    air: Air, grid: Grid, ground: float, streams: int, polarised: bool
) -> tuple[tuple[Floats, Floats], Floats, Floats, list[Floats]]:
    """What does not hang on the black ground's radiance.

    Returns  total transmittance up, (k, a, v), and down, (k, s); spherical albedo (k,); optical
             depth of the column (k,) and above each altitude
    """
    up = [
        (math.cos(zenith), min(ground + high, TOP))
        for high in grid.altitude
        for zenith in grid.sensor
    ]
    rays = [(cosine, 0.0, height) for cosine, height in up]
    rays += [(_off(sun), 0.0, TOP) for sun in grid.sun]
    rays += [(REFERENCE_SUN, 0.0, TOP)]
    found, heights, extinction = solve_radiance(
        air, grid.wavelength, ground, REFERENCE_SUN, rays, (0.0, *ALBEDOS), streams, polarised
    )
    first, second = (
        (lit - found[0]) / albedo for lit, albedo in zip(found[1:], ALBEDOS, strict=True)
    )
    spherical = ((second - first) / (ALBEDOS[1] * second - ALBEDOS[0] * first)).mean(-1)
    added = math.pi * first * (1 - ALBEDOS[0] * spherical[:, None]) / REFERENCE_SUN
    total = added / np.sqrt(added[:, -1:])  # the last ray goes back the way the light came
    depths = np.concatenate(
        [
            np.zeros((len(extinction), 1)),
            np.cumsum((extinction[:, 1:] + extinction[:, :-1]) / 2 * np.diff(heights), 1),
        ],
        1,
    )
    depth = depths[:, -1]
    above = [
        depth - np.array([np.interp(ground + high, heights, row) for row in depths])
        for high in grid.altitude
    ]
    split = len(up)
    upward = total[:, :split].reshape(-1, len(grid.altitude), len(grid.sensor))
    return (upward, total[:, split:-1]), spherical, depth, above


def _off(zenith: float) -> float:
    """The cosine of a zenith angle, off the ordinates of a solver, where it is singular."""
    return math.cos(max(zenith, 1e-4)) * (1 - 1e-9)
