"""Images of simulated terrain through the air."""

import numpy as np
import pytest

from startrack.core.streams import Streams
from startrack.core.units import deg, nm
from startrack.earth.atmosphere import Air, at_sensor, in_bands, load_table, sight_of
from startrack.earth.terrain import (
    ConstantHeight,
    Grid,
    Rays,
    cartesian,
    fractal,
    index,
    survey,
    up,
)
from startrack.io import shipped
from tests.earth.terrain.scenes import Relief

WEST, NORTH, STEP = 10 * deg, 47 * deg, 1 / 3600 * deg
HIGH = 500e3  # metre, of the camera


@pytest.fixture(scope="module")
def bands():
    table = load_table(shipped("atmosphere/rural-23km.fits"))
    assert table.air == Air()
    green = (np.abs(table.spectrum - 550 * nm) <= 10 * nm) / (20 * nm)
    return in_bands(table, green[None] * 1.0, HIGH)


@pytest.fixture(scope="module")
def hills():
    grid = Grid(WEST, NORTH, STEP, STEP, 101, 101)
    return Relief(index(grid, fractal(101, 101, Streams(1, 0), 1500.0)))


def downwards(count: int = 12) -> Rays:
    """From 500 km, at places around the middle of the hills."""
    steps = (20 + 60 * np.arange(count) / count) * STEP
    longitude, latitude = (each.ravel() for each in np.meshgrid(WEST + steps, NORTH - steps))
    zenith = up(longitude, latitude)
    origin = cartesian(longitude, latitude, np.full(len(longitude), HIGH))
    return Rays(origin, -zenith, np.zeros(len(zenith)))


def sun(elevation: float, azimuth: float = 1.0) -> np.ndarray:
    zenith = up(np.array(WEST + 50 * STEP), np.array(NORTH - 50 * STEP))
    east = np.cross([0.0, 0.0, 1.0], zenith)
    east /= np.linalg.norm(east)
    flat = np.cos(azimuth) * east + np.sin(azimuth) * np.cross(zenith, east)
    return np.cos(elevation) * flat + np.sin(elevation) * zenith


def total(ground, bands, rho=0.3):
    return at_sensor(ground, bands, np.array([rho]), np.array([rho])).total[:, 0]


def test_angles_are_those_of_the_scene():
    place = survey(ConstantHeight(0.0), downwards(2), sun(50 * deg))
    sight = sight_of(place)
    np.testing.assert_allclose(sight.sensor, 0, atol=1e-6)
    np.testing.assert_allclose(sight.sun, 40 * deg, atol=1e-3)
    np.testing.assert_allclose(sight.incidence, np.cos(sight.sun), atol=1e-9)


def test_azimuth_is_none_where_sun_and_camera_stand_on_one_side():
    target, light = downwards(1), sun(40 * deg)
    point = cartesian(*(np.array([one]) for one in (WEST + 50 * STEP, NORTH - 50 * STEP, 0.0)))
    for view, azimuth in ((sun(60 * deg), 0.0), (sun(60 * deg, 1.0 + np.pi), np.pi)):
        rays = Rays(point + 1e6 * view, -view[None], target.spread)
        assert sight_of(survey(ConstantHeight(0.0), rays, light)).azimuth[0] == pytest.approx(
            azimuth, abs=1e-3
        )


def test_slopes_towards_the_sun_are_bright_and_shadows_dark(hills, bands):
    ground = survey(hills, downwards(), sun(15 * deg))
    light = total(ground, bands)
    facing = np.cos(ground.sun_incidence)
    assert ground.shadow.any()
    assert np.corrcoef(facing[~ground.shadow], light[~ground.shadow])[0, 1] > 0.97
    assert light[ground.shadow].max() < light[~ground.shadow].mean()
    assert light[ground.shadow].min() > 0  # under the sky


def test_flat_ground_in_the_zenith_reflects_by_the_table(bands):
    ground = survey(ConstantHeight(0.0), downwards(1), sun(60 * deg))
    sight = sight_of(ground)
    black, grey = total(ground, bands, 0.0), total(ground, bands, 0.4)
    assert (grey > 2 * black).all()
    assert sight.lit.all()


def test_the_evening_ends_in_night(bands):
    seen = [
        total(survey(ConstantHeight(0.0), downwards(1), sun(elevation * deg)), bands)[0]
        for elevation in (20, 10.1, 9.9, 5, 1, -1, -10)
    ]
    assert np.all(np.diff(seen) <= 0)
    assert seen[1] == pytest.approx(seen[2], rel=0.05)  # no step where the table ends
    assert seen[-2:] == [0, 0]


def test_rays_into_the_sky_see_black(bands):
    rays = downwards(2)
    away = Rays(rays.origin, -rays.direction, rays.spread)
    np.testing.assert_array_equal(total(survey(ConstantHeight(0.0), away, sun(40 * deg)), bands), 0)


def test_ground_above_the_table_is_refused(bands):
    with pytest.raises(ValueError, match=r"height must lie in the table's \[0, 9000\]"):
        total(survey(ConstantHeight(12e3), downwards(1), sun(40 * deg)), bands)
