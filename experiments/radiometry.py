"""How accurate are the model of the air and its tables, and how fast are they applied?

Comparisons: the radiative transfer with published tables, another solver and MODTRAN; the shipped
table with direct runs at random places; error and time over the density of the table; magnitudes of
the limb. Times are the shortest of several, one thread.

    python experiments/radiometry.py [--json FILE] [--figure FILE] [--quick]

needs the extra `earth`; PythonicDISORT and pybsm, which contains runs of MODTRAN 5.2.1, are left
out if missing.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
import time
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import numpy as np
import one_thread  # noqa: F401
from scipy.spatial.transform import Rotation

from startrack import Streams, arcsec, deg, load_design, nm, observe, shipped, um
from startrack.benchmark import earth as cases
from startrack.core import Floats
from startrack.earth.atmosphere import (
    Air,
    AirTable,
    Reach,
    SlantPath,
    at_sensor,
    in_bands,
    load_table,
    look_up,
    radiance,
    refine,
)
from startrack.earth.geometry import EarthScene, observe_earth
from startrack.io import from_table
from startrack.plots import LINES, legend_below, picture, save_picture, styled
from startrack.scene import ObserverOrbit, Scene, load_limb, observer_of
from startrack.space import EARTH_RADIUS

sys.path.append(str(shipped("atmosphere")))  # folder of the scripts that build the tables
solver = importlib.import_module("air_solver")
SHIPPED, TOP, solve, build = (
    getattr(solver, name) for name in ("SHIPPED", "TOP", "solve_radiance", "build")
)

ROOT = Path(__file__).parents[1]
GREEN: Floats = np.array([550 * nm])
SUN = 0.5371  # cosine, between the ordinates of the solvers
BANDS = 25
REPEATS = 5
PLACES = 60  # number of places for the comparison of table and solver

# Natraj, Li and Yung (2009), ApJ 691, 1909: Stokes I of the corrected tables of Coulson, Dave and
# Sekera (1960) for optical depth 0.5, albedo 0.8, cosine of the Sun 0.2, irradiance pi:
# (cosine of the sensor, azimuth in degree) -> I
NATRAJ = {
    (0.02, 0.0): 0.47382125,
    (0.4, 0.0): 0.23059806,
    (1.0, 0.0): 0.13280858,
    (0.02, 60.0): 0.33343531,
    (0.4, 60.0): 0.18923236,
    (1.0, 60.0): 0.13280858,
}

# The background of pybsm's runs of MODTRAN, "mixed forest", from its README.
FOREST_AT: Floats = np.array([0.2, 0.5, 0.7, 0.725, 0.75, 0.775, 0.9, 0.925, 1.0, 1.25]) * um
FOREST: Floats = np.array([0.025, 0.036, 0.032, 0.097, 0.254, 0.314, 0.31, 0.419, 0.4, 0.384])
TARGET = 0.15
AUGUST_23 = 1.0104  # astronomical units
STRONG_BANDS = ((680, 740), (810, 845), (890, 1000))  # nm, bands of water
OXYGEN_BAND = (750, 775)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument(
        "--figure", type=Path, help="file for the picture of the spectrum and the table's error"
    )
    chosen = command.read(parser)
    quick = chosen.quick
    if command.missing("everything is", "sasktran2", "rasterio"):
        return
    table = load_table(shipped("atmosphere/rural-23km.fits"))
    figures: dict[str, Any] = {
        "rayleigh_od_550": optical_depth(),
        "natraj_max_relative_error": natraj(),
        "disort_max_relative_error": disort(),
        "energy_closure": closure(),
        **modtran(),
        **(table_error(table, Air("none"), 1, 1) if quick else table_error(table, table.air)),
        **speed(table, *((100, 1) if quick else (1000, REPEATS))),
        **nadir(table, *((100, 1) if quick else (1000, 3))),
        "limb_magnitudes": limb(),
        **tracker_at_the_limb(1 if quick else 40),
    }
    for name, value in figures.items():
        print(f"{name:32} {value}")
    command.save(chosen, figures)
    if chosen.figure:
        draw(table, chosen.figure, 100 if quick else 1)


def optical_depth() -> float:
    """Optical depth of molecules at 550 nm; 0.0973 by Bodhaine et al. (1999)."""
    _, heights, extinction = solve(Air("none"), GREEN, 0.0, SUN, [(1.0, 0.0, TOP)], (0.0,), 4)
    return float(np.trapezoid(extinction[0], heights))


def natraj() -> float:
    """sasktran2 with the settings of the tables, on the single layer of Coulson, Dave and
    Sekera."""
    sk = importlib.import_module("sasktran2")
    config = sk.Config()
    config.num_streams, config.num_stokes, config.num_singlescatter_moments = 40, 3, 40
    config.multiple_scatter_source = sk.MultipleScatterSource.DiscreteOrdinates
    config.single_scatter_source = sk.SingleScatterSource.DiscreteOrdinates
    heights = np.array([0.0, 1.0])
    geometry = sk.Geometry1D(
        0.2,
        0.0,
        6371e3,
        heights,
        sk.InterpolationMethod.LowerInterpolation,
        sk.GeometryType.PlaneParallel,
    )
    view = sk.ViewingGeometry()
    for cosine, azimuth in NATRAJ:
        view.add_ray(sk.GroundViewingSolar(0.2, math.radians(azimuth), cosine, 200e3))
    state = sk.Atmosphere(geometry, config, numwavel=1, calculate_derivatives=False)
    moments = np.zeros((4 * 40, 2, 1))
    moments[0], moments[8], moments[9], moments[11] = 1.0, 0.5, 3.0, -math.sqrt(6) / 2
    ones = np.ones((2, 1))
    state["layer"] = sk.constituent.Manual(0.5 * ones, ones, moments)
    state["surface"] = sk.constituent.LambertianSurface(0.8)
    found = sk.Engine(config, geometry, view).calculate_radiance(state).radiance.to_numpy()
    stokes = math.pi * found[0, :, 0]
    return float(np.max(np.abs(stokes / np.array(list(NATRAJ.values())) - 1)))


def cells(air: Air, rays: list[tuple[float, float, float]], streams: int) -> tuple[Floats, Floats]:
    """Radiance added by white ground, and the spherical albedo, at 550 nm."""
    albedos = (0.0, 0.25, 0.75)
    found = solve(air, GREEN, 0.0, SUN, rays, albedos, streams)[0][:, 0]
    first, second = ((lit - found[0]) / a for lit, a in zip(found[1:], albedos[1:], strict=True))
    spherical = (second - first) / (albedos[2] * second - albedos[1] * first)
    return first * (1 - albedos[1] * spherical), spherical


def disort() -> float | None:
    """Transmitted flux of clear air, and the same by PythonicDISORT."""
    if command.missing("the flux of another solver is", "PythonicDISORT"):
        return None
    import warnings

    worst = 0.0
    _, heights, extinction = solve(Air("none"), GREEN, 0.0, SUN, [(1.0, 0.0, TOP)], (0.0,), 4)
    depth = np.trapezoid(extinction[0], heights)
    king = 1.0484  # Bates (1984) at 550 nm
    depolarisation = 6 * (king - 1) / (7 * king + 3)
    phase = np.zeros((1, 17))
    phase[0, [0, 2]] = 1, (1 - depolarisation) / (2 + depolarisation) / 5
    for sun in (SUN, 0.2123, 0.9531):
        added, _ = cells(Air("none"), [(SUN, 0.0, TOP), (sun, 0.0, TOP)], 16)
        own = math.sqrt(math.pi * added[0] / SUN)
        ours = math.pi * added[1] / SUN / own
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            solved = importlib.import_module("PythonicDISORT").pydisort(
                depth, np.array([1 - 1e-7]), 16, phase, sun, 1.0, 0.0, only_flux=True
            )
        theirs = sum(solved[2](depth)) / sun
        worst = max(worst, abs(ours / theirs - 1))
    return worst


def closure() -> float:
    """Fraction of light that clear air neither transmits nor reflects."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    cosines, weights = (nodes + 1) / 2, weights / 2
    added, spherical = cells(Air("none"), [(c, 0.0, TOP) for c in [*cosines, SUN]], 8)
    total = math.pi * added / SUN
    total /= math.sqrt(total[-1])
    return float(abs(spherical.mean() + 2 * (weights * cosines) @ total[:-1] - 1))


def modtran() -> dict[str, Any]:
    """Nadir from 24.5 km, Sun at 50 degrees, rural 23 km, compared with pybsm's rows of MODTRAN.

    With the solar spectrum of MODTRAN's runs, so that only the air is compared; the visible also
    with the shipped spectrum.
    """
    names = ("vis_max", "vis_mean", "nir_max", "water_max", "oxygen_max", "vis_max_own_sun")
    if command.missing("MODTRAN is", "pybsm"):
        return {f"modtran_total_{name}": None for name in names}
    utils = importlib.import_module("pybsm.utils")
    rows = utils.load_database_atmosphere_no_interp(altitude=24500.0, ground_range=0, ihaze=1)
    theirs = json.loads((ROOT / "tests/oracle/modtran_sun.json").read_text(encoding="utf-8"))
    wavelength = np.array(theirs["wavelength_nm"]) * nm
    total = np.array([np.interp(wavelength, rows[:, 0], rows[:, i]) for i in (2, 3, 4, 5)]).sum(0)
    grid = SHIPPED._replace(
        height=np.array([0.0]),
        altitude=np.array([2e3, 15e3, 24.5e3, TOP]),
        sun=np.array([0.0, 50.0]) * deg,
        azimuth=np.array([0.0, 90.0, 180.0]) * deg,
    )
    table = build(Air(), grid, polarised=False)  # MODTRAN is also without polarisation
    response = triangles(table, wavelength, 20 * nm)
    bands = in_bands(table, response, 24500.0, AUGUST_23)
    forest = np.interp(wavelength, FOREST_AT, FOREST)
    fine = refine(bands, Reach((0.0, 0.0), (0.0, 0.0), (50 * deg, 50 * deg), (90 * deg, 90 * deg)))
    flat = np.ones(1)
    sight = SlantPath(
        0 * flat, 0 * flat, 50 * deg * flat, 90 * deg * flat, math.cos(50 * deg) * flat, flat, flat
    )
    ours = radiance(fine, sight, np.full(len(wavelength), TARGET), forest).total[0]
    own = (response * np.gradient(table.spectrum)) @ table.irradiance
    error = np.abs(ours * (np.array(theirs["irradiance"]) / nm / own) / total - 1)
    at = wavelength / nm
    strong = np.any([(at >= low) & (at <= high) for low, high in STRONG_BANDS], axis=0)
    oxygen = (at >= OXYGEN_BAND[0]) & (at <= OXYGEN_BAND[1])
    visible = (at >= 450) & (at <= 670)
    infrared = (at >= 780) & (at <= 1000) & ~strong
    figures = (
        error[visible].max(),
        error[visible].mean(),
        error[infrared].max(),
        error[strong].max(),
        error[oxygen].max(),
        np.abs(ours / total - 1)[visible].max(),
    )
    return {f"modtran_total_{name}": float(one) for name, one in zip(names, figures, strict=True)}


def triangles(table: AirTable, centres: Floats, width: float) -> Floats:
    """Bands with a triangular response of area one; `width` at half height."""
    shape = np.clip(1 - np.abs(table.spectrum - centres[:, None]) / width, 0, None)
    return shape / (shape * np.gradient(table.spectrum)).sum(-1)[:, None]


def table_error(
    table: AirTable, air: Air, places: int = PLACES, colours: int = 3
) -> dict[str, Any]:
    """The table at random places, compared with runs of the solver, for ground of albedo 0.3.

    air  air of the table; with --quick, air without particles
    """
    rng = np.random.default_rng(1)
    wavelength = np.array([450, 550, 800])[:colours] * nm
    node = np.argmin(np.abs(table.spectrum - wavelength[:, None]), 1)
    response = np.zeros((colours, len(table.spectrum)))
    response[range(colours), node] = 1
    # the solver has no lines of gases
    bare = AirTable(**{**vars(table), "gas": np.ones_like(table.gas)})
    unit = response @ (np.gradient(table.spectrum) * table.irradiance)
    errors = []
    bands = in_bands(bare, response, TOP)
    ground = np.full(colours, 0.3)
    for _ in range(places):
        height = rng.uniform(0, 4e3)
        sensor, sun = rng.uniform(0, 70, 2) * deg
        azimuth = rng.uniform(0, math.pi)
        here = Reach(*((value, value) for value in (height, sensor, sun, azimuth)))
        whole = (height, sensor, sun, azimuth, math.cos(sun), 1.0, 1.0)
        sight = SlantPath._make(np.array([value]) for value in whole)
        ours = radiance(refine(bands, here), sight, ground, ground).total[0]
        rays = [(math.cos(sensor), math.pi - azimuth, TOP)]
        direct = solve(air, table.spectrum[node], height, math.cos(sun), rays, (0.3,), 8, True)
        errors.append(np.abs(ours / unit / direct[0][0, :, 0] - 1))
    return {
        "table_error_median": float(np.median(errors)),
        "table_error_p95": float(np.quantile(errors, 0.95)),
        "table_error_places": places,
    }


def speed(table: AirTable, side: int, repeats: int) -> dict[str, Any]:
    """Million pixels a second in 25 bands, by startrack, and by scipy's interpolator on the path
    term alone."""
    from scipy.interpolate import RegularGridInterpolator

    response = triangles(table, np.linspace(420, 900, BANDS) * nm, 20 * nm)
    reach = Reach((0.0, 2e3), (0.0, 5 * deg), (40 * deg, 45 * deg), (0.0, math.pi))
    fine = refine(in_bands(table, response, 600e3), reach)
    whole = cases.image(side)
    block = SlantPath(*(values[: 2**15] for values in whole))
    pixels = min(side**2, 2**15)
    reflectance = np.full((pixels, BANDS), 0.2, np.float32)
    around = np.full(BANDS, 0.2)
    ours = least(lambda: look_up(fine, block, reflectance, around), repeats) / pixels
    axes = [
        start + step * np.arange(size)
        for start, step, size in zip(fine.start, fine.step, fine.path.shape, strict=False)
    ]
    scipys = RegularGridInterpolator(axes, fine.path)
    places = np.stack(block[:4], -1)
    theirs = least(lambda: scipys(places), repeats) / pixels
    return {
        "lookup_mpx_per_s": 1e-6 / ours,
        "scipy_mpx_per_s": 1e-6 / theirs,
        "lookup_bands": BANDS,
    }


def nadir(table: AirTable, side: int, repeats: int) -> dict[str, float]:
    """CPU seconds of a square image: geometry with shadow, and radiance in one band.

    Synthetic mountains from 600 km, one ray per pixel, 9.5 m cells of 30 m terrain, low Sun in the
    south.
    """
    text = tomllib.loads(shipped("scenes/mountains.toml").read_text(encoding="utf-8"))
    text["sky_rays"] = 0
    text["sensor"] |= {"columns": side, "lines": side, "pixel_pitch": "9.6 um"}
    scene = from_table(EarthScene, text)
    bands = in_bands(table, triangles(table, np.array([550 * nm]), 20 * nm), 600e3)
    grey = np.full(1, 0.3)

    def seen() -> None:
        for strip in observe_earth(scene, Path()):
            at_sensor(strip.ground, bands, grey, grey)

    def shape() -> None:
        for _ in observe_earth(scene, Path()):
            pass

    return {"nadir_1mpx_s": least(seen, repeats), "nadir_1mpx_geometry_s": least(shape, repeats)}


def by_scipy() -> dict[str, Callable[[], Floats]]:
    """The same table and terms by scipy's interpolator, for flat ground without shadow."""
    from scipy.interpolate import RegularGridInterpolator

    scene = cases.scenery()
    fine, bands = scene.fine, len(scene.node)
    axes = [
        start + step * np.arange(size)
        for start, step, size in zip(fine.start, fine.step, fine.path.shape, strict=False)
    ]
    path = RegularGridInterpolator(axes, fine.path)
    ground = RegularGridInterpolator(axes[:3], fine.ground)
    back = RegularGridInterpolator(axes[:1], fine.backscatter)
    places = np.stack(scene.sight[:4], -1)

    def read() -> Floats:
        below = ground(places[:, :3])
        beam, sky, around = (below[:, n * bands : (n + 1) * bands] for n in range(3))
        bounced = cases.ALBEDO * back(places[:, :1])
        bounced /= 1 - bounced
        lit = cases.ALBEDO * (beam + sky) * (1 + bounced)
        return (lit + path(places) + around * cases.ALBEDO * (1 + bounced))[scene.pick] / scene.unit

    return {"scipy": read}


def least(work: Any, repeats: int = REPEATS) -> float:
    """CPU time of the fastest of several runs, second."""
    times = []
    for _ in range(repeats + 1):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times[1:])


def limb() -> dict[str, float]:
    """Magnitude of a pixel of 60 arcsec at 550 nm with the Sun at 30 degrees, for the limb and for
    ground by day."""
    table = load_limb(shipped("atmosphere/limb.fits"))
    sun, vega = 1.863, 3.63e-11  # W / m^2 / nm at 550 nm
    pixel = (60 * arcsec) ** 2
    heights = np.array([20e3, 40e3, 60e3, 80e3])
    flat = np.ones(4)
    light = table(GREEN, heights, 30 * deg * flat, 90 * deg * flat)[:, 0]
    day = np.array([0.3 / math.pi * math.cos(30 * deg)])
    seen = -2.5 * np.log10(np.concatenate([light, day]) * sun * pixel / vega)
    names = ("20 km", "40 km", "60 km", "80 km", "day ground of albedo 0.3")
    return dict(zip(names, (round(float(one), 2) for one in seen), strict=True))


def tracker_at_the_limb(trials: int) -> dict[str, Any]:
    """The nanosatellite's tracker with the sunlit Earth over a third of its field."""
    design = load_design(shipped("designs/noise_only.toml")).case
    orbit = ObserverOrbit(600e3, phase=0.0)
    scene = Scene(lights=("earth", "sun"), date="2026-03-20T12:00:00", orbit=orbit)
    case = replace(design, scene=scene)
    observer = observer_of(scene, Streams(0, 0))
    down = observer.earth / np.linalg.norm(observer.earth)
    horizon = math.asin(EARTH_RADIUS / float(np.linalg.norm(observer.earth)))
    # The horizon lies a sixth of the field from its middle.
    tilt = horizon + case.instrument.camera.fov_y / 6
    outcomes = []
    for number in range(trials):
        side = Rotation.from_rotvec(down * 2 * math.pi * number / trials).apply(
            np.cross(down, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(down, [0.0, 0.0, 1.0]))
        )
        boresight = math.cos(tilt) * down + math.sin(tilt) * side
        third = np.cross(boresight, down) / np.linalg.norm(np.cross(boresight, down))
        attitude = Rotation.from_matrix([third, np.cross(boresight, third), boresight])
        outcomes.append(observe(case, attitude, Streams(1, number)).outcome)
    return {
        "limb_frames": trials,
        "limb_frames_solved": sum(one.solved and not one.false for one in outcomes),
        "limb_false_attitudes": sum(bool(one.false) for one in outcomes),
    }


@styled
def draw(table: AirTable, path: Path, every: int) -> None:
    """The spectrum of figure 3: Sun in the zenith, sensor at 100 km, albedo 0.5, 1 nm."""
    within = (table.spectrum >= 400 * nm) & (table.spectrum <= 2400 * nm)
    shown = np.flatnonzero(within)[::every]
    wavelength = table.spectrum[shown]
    response = np.zeros((len(shown), len(table.spectrum)))
    response[range(len(shown)), shown] = 1 / np.gradient(table.spectrum)[shown]
    fine = refine(
        in_bands(table, response, TOP), Reach((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    )
    flat = np.ones(1)
    half = np.full(len(shown), 0.5)
    parts = radiance(
        fine, SlantPath(0 * flat, 0 * flat, 0 * flat, 0 * flat, flat, flat, flat), half, half
    )
    figure = picture(4.6, "Sun in the zenith, sensor at 100 km, albedo 0.5, rural aerosol 23 km")
    axes = figure.subplots()
    for name, line in zip(("direct", "indirect", "scattered", "total"), LINES, strict=False):
        axes.plot(wavelength / um, getattr(parts, name)[0] * 1e-6, ls=line, label=name, lw=1)
    axes.set_xlabel("wavelength (um)")
    axes.set_ylabel("spectral radiance (W / m$^2$ / sr / um)")
    legend_below(axes, 4)
    save_picture(path, figure)


if __name__ == "__main__":
    command.run(main)
