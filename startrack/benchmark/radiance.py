"""Radiance at the sensor in many bands, from the shipped table, against the solver itself."""

from __future__ import annotations

import math
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.benchmark.stage import Stage
from startrack.core import Floats, deg, nm
from startrack.earth.atmosphere import (
    AirTable,
    FineTable,
    Reach,
    Sight,
    in_bands,
    load_table,
    look_up,
    refine,
)
from startrack.io import shipped

WAVELENGTHS: Floats = np.array([450, 550, 800]) * nm
ALBEDO = 0.2
SIDE = 180  # pixels of the image
PLACES = 24  # pixels that the solver computes
REACH = Reach((0.0, 2e3), (0.0, 5 * deg), (40 * deg, 45 * deg), (0.0, math.pi))


def image(size: int) -> Sight:
    """A nadir image over hills, as smooth as images are."""
    y, x = np.mgrid[:size, :size] / size
    height = 1000 + 900 * np.sin(7 * x) * np.cos(5 * y)
    sensor = (0.1 + 4.8 * np.hypot(x - 0.5, y - 0.5)) * deg
    sun = (40.5 + 4 * x) * deg
    azimuth = np.abs(np.arctan2(y - 0.5, x - 0.5))
    flat = np.ones(size * size)
    places = [part.ravel() for part in (height, sensor, sun, azimuth)]
    return Sight._make([*places, np.cos(places[2]), flat, flat])


def lines(table: AirTable) -> tuple[AirTable, Floats, NDArray[np.intp]]:
    """The table without gas lines, which the solver has not; single wavelengths; their nodes."""
    node = np.argmin(np.abs(table.spectrum - WAVELENGTHS[:, None]), 1)
    response = np.zeros((len(node), len(table.spectrum)))
    response[range(len(node)), node] = 1
    return AirTable(**{**vars(table), "gas": np.ones_like(table.gas)}), response, node


class Scenery(NamedTuple):
    """An image of hills, and the table that it is made from.

    fine  the part of the table that the image needs, in the wavelengths' bands
    unit  (bands,) what a radiance is divided by to be a fraction of the sunlight
    node  (bands,) of the wavelengths in the table
    pick  pixels that are judged
    """

    table: AirTable
    fine: FineTable
    sight: Sight
    unit: Floats
    node: NDArray[np.intp]
    pick: NDArray[np.intp]


def scenery() -> Scenery:
    """What all ways get."""
    table = load_table(shipped("atmosphere/rural-23km.fits"))
    bare, response, node = lines(table)
    unit = response @ (np.gradient(table.spectrum) * table.irradiance)
    fine = refine(in_bands(bare, response, 600e3), REACH)
    pick = np.linspace(0, SIDE**2 - 1, PLACES).astype(np.intp)
    return Scenery(table, fine, image(SIDE), unit, node, pick)


def radiance() -> Stage:
    """Three wavelengths of an image of hills."""
    scene = scenery()
    ground = np.full((SIDE**2, len(scene.node)), ALBEDO, np.float32)
    around = np.full(len(scene.node), ALBEDO)
    wanted, missing = None, "the solver needs the extra `earth`; without it there is no error"
    if find_spec("sasktran2"):
        wanted, missing = direct(scene), ""

    def ours() -> Floats:
        parts = look_up(scene.fine, scene.sight, ground, around)
        return (parts[0] + parts[1] + parts[2])[scene.pick] / scene.unit

    def judge(found: Floats) -> float:
        return math.nan if wanted is None else float(np.median(np.abs(found / wanted - 1)))

    return Stage(
        "radiance",
        f"a pixel of an image of hills at {len(scene.node)} wavelengths, seen from an orbit",
        "median against runs of the solver, relative",
        {"startrack": ours},
        judge,
        pieces=SIDE**2,
        missing=missing,
    )


def direct(scene: Scenery) -> Floats:
    """The solver's reflectance at the pixels that are judged, (n, bands), for one unit of light."""
    from startrack.earth.atmosphere import TOP
    from startrack.earth.atmosphere import solve_radiance as solve

    rows, wavelength = [], scene.table.spectrum[scene.node]
    for i in scene.pick:
        height, sensor, sun, azimuth = (part[i] for part in scene.sight[:4])
        rays = [(math.cos(sensor), math.pi - azimuth, TOP)]
        found = solve(scene.table.air, wavelength, height, math.cos(sun), rays, (ALBEDO,), 8, True)
        rows.append(found[0][0, :, 0])
    return np.array(rows)
