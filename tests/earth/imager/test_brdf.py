"""Reflectance over directions: kernels, glint and snow against other programs and integrals."""

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from startrack.core import Curve, Refused
from startrack.core.units import deg, nm
from startrack.earth.imager import load_survey
from startrack.earth.imager.brdf import (
    Angles,
    RossLi,
    Snow,
    Water,
    direct_factor,
    kernels,
    sky_factor,
    snow_factor,
)
from startrack.earth.imager.land import Cover, Land, ReflectanceMap, reflectance, reflection
from startrack.earth.terrain import ConstantHeight, Ground, Rays, cartesian, survey, up
from startrack.io import shipped

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT / "experiments"))
ORACLE = json.loads((ROOT / "tests/oracle/brdf.json").read_text())
PLACE = np.array(10 * deg), np.array(47 * deg)
BAND = np.array([550 * nm]), np.ones(1)
MEADOW = 0.08, 0.04, 0.012  # weights of MCD43 in the green, typical of grass
LAWS = (RossLi(), Water(5.0), Snow())


def angles(sun, camera, azimuth) -> Angles:
    """Zenith angles and the azimuth between Sun and camera, degree."""
    sun, camera, azimuth = (np.radians(np.asarray(one, float)) for one in (sun, camera, azimuth))
    one, other = np.cos(sun), np.cos(camera)
    phase = one * other + np.sin(sun) * np.sin(camera) * np.cos(azimuth)
    return Angles(*np.broadcast_arrays(one, other, phase))


def test_kernels_and_snow_are_those_of_sasktran2():
    columns = {key: np.array([row[key] for row in ORACLE["rows"]]) for key in ORACLE["rows"][0]}
    seen = angles(columns["sun"], columns["camera"], columns["azimuth"])
    volumetric, geometric = kernels(seen)
    np.testing.assert_allclose(volumetric, columns["volumetric"], atol=1e-12)
    np.testing.assert_allclose(geometric, columns["geometric"], atol=1e-12)
    snow = snow_factor(np.array(ORACLE["snow_albedo"]), seen)
    np.testing.assert_allclose(snow, columns["snow"], rtol=1e-9)


def test_kernels_and_glint_are_their_integrals():
    """Integrals over leaves, shadows and facets of waves; see `experiments/earth_surfaces.py`."""
    from earth_surfaces import glint_error, rossli_error

    assert rossli_error() < 0.005
    assert glint_error() < 0.01


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_sun_and_camera_may_be_exchanged(law):
    rng = np.random.default_rng(1)
    one, other = rng.uniform(0, 70, (2, 100))
    rho, turn = np.full(100, 0.3), rng.uniform(0, 360, 100)
    here, there = angles(one, other, turn), angles(other, one, turn)
    seen = direct_factor(law, rho, MEADOW, here)
    np.testing.assert_allclose(seen, direct_factor(law, rho, MEADOW, there), rtol=1e-9)
    assert seen.min() >= 0


@pytest.mark.parametrize(
    ("law", "within"),
    list(zip(LAWS, (8e-3, 6e-3, 0.03), strict=True)),
    ids=lambda each: type(each).__name__,
)
def test_the_sky_reflects_the_mean_over_all_suns(law, within):
    """Errors: kernels are cut off at 0 near the horizon, waves reflect below it, snow is a
    model."""
    node, weight = np.polynomial.legendre.leggauss(80)
    sun = (node[:, None] + 1) / 2
    turn = (np.arange(360) + 0.5) / 2
    for camera in (0.0, 40.0):
        seen = angles(np.degrees(np.arccos(sun)), camera, turn)
        rho = np.full(sun.shape, 0.8)
        mean = direct_factor(law, rho, MEADOW, seen).mean(1) @ (weight * sun[:, 0])
        sky = sky_factor(law, rho[:1, 0], MEADOW, np.cos(np.radians([camera])))[0]
        assert mean == pytest.approx(sky, rel=within)


def test_the_albedo_of_land_is_that_of_the_polynomials_of_modis():
    """Under a uniform sky: 1, 0.189184, -1.377622 times the weights (Lucht et al. 2000)."""
    node, weight = np.polynomial.legendre.leggauss(40)
    camera = (node + 1) / 2
    sky = sky_factor(RossLi(), np.full(camera.shape, MEADOW[0]), MEADOW, camera)
    published = MEADOW @ np.array([1, 0.189184, -1.377622])
    assert sky @ (weight * camera) == pytest.approx(published, rel=2e-3)


def below(sun: float, camera: float, height: float = 0.0) -> Ground:
    """One ray at an angle from the vertical, away from the Sun, in radian."""
    rise = up(*PLACE)
    east = np.array([-np.sin(PLACE[0]), np.cos(PLACE[0]), 0.0])
    look = np.cos(camera) * rise - np.sin(camera) * east
    origin = cartesian(*PLACE, np.array(height)) + 2e3 * look
    ray = Rays(origin[None], -look[None], np.full(1, 1e-6))
    return survey(ConstantHeight(height), ray, np.cos(sun) * rise + np.sin(sun) * east)


def test_glint_is_where_the_sea_mirrors_the_sun():
    sea = Land((Cover(Curve((), (0.01,)), water=Water(2.0)),))
    bright, dark = (
        reflection(sea, below(30 * deg, look * deg), *BAND).direct[0] for look in (30, -30)
    )
    assert bright > 0.3
    assert dark < 0.0101
    # In a calm the mirror is brighter; a wind of 10 m/s leaves 0.013 / 0.054 of its peak.
    rough = Land((Cover(Curve((), (0.01,)), water=Water(10.0)),))
    peak = reflection(rough, below(30 * deg, 30 * deg), *BAND).direct[0]
    foam = 0.01 + 0.22 * 2.95e-6 * 10**3.52
    assert (peak - foam) / (bright - 0.01) == pytest.approx(0.01324 / 0.0542, rel=0.02)


def test_ground_without_a_law_reflects_alike_to_all_sides():
    land = Land((Cover(), Cover(above=100.0, snow=Snow())))
    low, high = (reflection(land, below(50 * deg, 40 * deg, h), *BAND) for h in (0.0, 200.0))
    assert low == (0.2, 0.2, 0.2)
    assert high.direct[0] != high.sky[0] != high.albedo[0] == 0.2
    plain = reflection(Land(), below(0.0, 0.0), *BAND)
    assert plain.direct is plain.sky is plain.albedo


def test_maps_replace_the_reflectance_of_covers():
    land = Land(maps=(ReflectanceMap("b2", 490 * nm, 1e-4), ReflectanceMap("b4", 665 * nm, 1e-4)))
    ground = below(0.0, 0.0)
    mapped = replace(ground, maps={"b2": np.array([1000.0]), "b4": np.array([2750.0])})
    assert reflectance(land, mapped, *BAND)[0] == pytest.approx(0.16)  # 60 of 175 nm
    empty = replace(ground, maps={"b2": np.full(1, math.nan), "b4": np.zeros(1)})
    assert reflectance(land, empty, *BAND)[0] == 0.2
    with pytest.raises(
        ValueError, match=r"land.maps must name maps of the terrain, none, got 'b2'"
    ):
        reflectance(land, ground, *BAND)
    numbers = Land(maps=(ReflectanceMap("b2", 490 * nm), ReflectanceMap("b4", 665 * nm)))
    with pytest.raises(Refused, match=r"by factor and offset, at most 2, got 1000 of 'b2'"):
        reflectance(numbers, mapped, *BAND)


def test_a_spectrum_may_be_in_a_file_of_a_library(tmp_path):
    text = shipped("scenes/hsrs.toml").read_text()
    curve = 'reflectance = { file = "grass.txt", factor = 0.01 }'
    curve += "\nross_li = { volumetric = { value = [0.1] } }"
    start = text.index("reflectance = {")
    scene = text[:start] + curve + text[text.index("\n", start) :]
    path = tmp_path / "scene.toml"
    path.write_text(scene)
    with pytest.raises(FileNotFoundError, match=r"grass.txt must be a table of a spectrum"):
        load_survey(path)
    (tmp_path / "grass.txt").write_text("Name: grass\n2.5\t40\n0.5\t4.0\n0.4\t-1.2e34\n")
    cover = load_survey(path).land.covers[0]
    assert cover.reflectance(np.array([500 * nm, 2500 * nm])) == pytest.approx([0.04, 0.4])
    assert cover.weights(np.array([1500 * nm]), np.ones(1)) == pytest.approx((0.22, 0.1, 0.0))
    (tmp_path / "grass.txt").write_text("Name: grass\n")
    with pytest.raises(ValueError, match=r"grass.txt must hold a wavelength and a value .*, got 0"):
        load_survey(path)


def test_covers_have_one_law():
    with pytest.raises(ValueError, match="only one of ross_li, water and snow must be given"):
        Cover(water=Water(), snow=Snow())
    with pytest.raises(ValueError, match=r"wind must lie in \[0, 20\], got 30"):
        Water(30.0)
