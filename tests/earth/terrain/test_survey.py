"""Properties of the ground: shadow, angles, sky, and the height at which rays miss."""

import numpy as np
import pytest

from startrack.earth.terrain import (
    ConstantHeight,
    Grid,
    Rays,
    TerrainScan,
    cartesian,
    index,
    survey,
    up,
)

from .scenes import STEP, Relief, axes, flat, mountains, random_rays, ray

GRID, HEIGHTS = mountains()
EAST, NORTH, RISE = axes(GRID.west + 100 * STEP, GRID.north - 100 * STEP)


def sun_at(elevation, azimuth):
    e, a = np.radians([elevation, azimuth])
    return np.sin(e) * RISE + np.cos(e) * (np.sin(a) * EAST + np.cos(a) * NORTH)


@pytest.mark.parametrize("elevation", [60, 25, 8, 1])
def test_shadows_are_those_of_the_search(elevation):
    rays = random_rays(GRID, 500, 80, HEIGHTS.max())
    sun = sun_at(elevation, 120)
    found = survey(Relief(index(GRID, HEIGHTS)), rays, sun)
    expected = survey(TerrainScan(GRID, HEIGHTS, 2.8e5, 3.2e5), rays, sun)
    assert 0 < expected.shadow.sum() < 500 or elevation == 60
    np.testing.assert_array_equal(found.shadow, expected.shadow)


def test_no_light_comes_from_under_the_horizon():
    rays = random_rays(GRID, 200, 80, HEIGHTS.max())
    for ground in (
        Relief(index(GRID, HEIGHTS)),
        Relief(index(GRID, HEIGHTS), 0.0),
        ConstantHeight(),
    ):
        assert survey(ground, rays, sun_at(-5, 0)).shadow.all()


def test_a_summit_sees_the_sun_beyond_the_level_horizon():
    """From a peak of 3 km the horizon is lower by acos(R / (R + h)) = 1.76 degree."""
    grid, heights = flat(cells=20)
    heights[10, 10] = 3000.0
    rays = ray(grid.west + 10 * STEP, grid.north - 10 * STEP, 3000.0, 90)
    east, _, rise = axes(grid.west + 10 * STEP, grid.north - 10 * STEP)
    ground = Relief(index(grid, heights), 0.0)
    for dip, dark in ((1.70, False), (1.82, True)):
        sun = -np.sin(np.radians(dip)) * rise - np.cos(np.radians(dip)) * east
        # The very top is a kink; take a point just on its sunny side.
        near = Rays(rays.origin - 0.5 * east, rays.direction, rays.spread)
        assert survey(ground, near, sun).shadow[0] == dark


def test_angles_on_the_ellipsoid():
    rays = ray(0.2, 0.8, 0.0, 40, 1.0)
    sun = up(np.array(0.2), np.array(0.9))
    found = survey(ConstantHeight(), rays, sun)
    assert np.degrees(found.incidence[0]) == pytest.approx(50, abs=1e-9)
    assert found.sun_incidence[0] == pytest.approx(0.1, abs=1e-12)
    assert found.view_zenith[0] == pytest.approx(found.incidence[0], abs=1e-12)
    assert found.sun_zenith[0] == pytest.approx(0.1, abs=1e-12)


def test_the_tangent_height_of_rays_that_miss():
    """Horizontal rays at a known height: it is their least height, in the meridian and across
    it."""
    for height, azimuth in ((2e4, 0.3), (1.2e5, 1.4)):
        point = cartesian(np.array(0.3), np.array(0.7), np.array(height))
        east, north, rise = axes(0.3, 0.7)
        view = np.sin(azimuth) * east + np.cos(azimuth) * north
        rays = Rays(point[None] - 2e6 * view, view[None], np.zeros(1))
        found = survey(ConstantHeight(), rays, rise)
        assert not found.hit[0]
        assert found.level[0] == -1
        assert found.tangent_height[0] == pytest.approx(height, abs=1e-3)
        away = survey(
            ConstantHeight(), Rays(point[None] + 1e5 * view, view[None], np.zeros(1)), rise
        )
        assert away.tangent_height[0] > height


def test_the_sky_seen_from_a_spherical_bowl():
    """In a spherical bowl every point sees 1 - cap / whole sphere, at any place.

    Closed form of the integrating sphere: each surface element of a sphere sends the same fraction
    of its light to each other one.
    """
    cells, radius, depth = 160, 2500.0, 1000.0
    grid = Grid(0.0, 80 * STEP, STEP, STEP, cells + 1, cells + 1)
    steps = STEP * np.arange(cells + 1)
    at = cartesian(
        *np.broadcast_arrays(grid.west + steps, (grid.north - steps)[:, None], np.zeros(()))
    )
    middle = at[80, 80]
    across = np.linalg.norm(at - middle, axis=-1)
    rim = np.sqrt(radius**2 - (radius - depth) ** 2)
    bowl = radius - np.sqrt(np.maximum(radius**2 - across**2, 0)) - depth
    heights = np.where(across < rim, bowl, 0.0) + across**2 / 2 / 6.378e6
    rays = ray(STEP * np.array([80.3, 85.2, 92.1]), 0.3 * STEP, -500.0, 90)
    found = survey(Relief(index(grid, heights)), rays, up(np.array(0.0), np.array(0.0)), 1024)
    np.testing.assert_allclose(found.sky_view, 1 - depth / (2 * radius), atol=0.01)


def test_a_flat_earth_sees_all_of_the_sky():
    found = survey(
        ConstantHeight(), ray(0.2, 0.8, 0.0, 40, 1.0), up(np.array(0.2), np.array(0.9)), 64
    )
    np.testing.assert_array_equal(found.sky_view, 1.0)


def test_a_wrong_sun_is_refused():
    with pytest.raises(ValueError, match="sun must be one unit vector"):
        survey(ConstantHeight(), ray(0.2, 0.8, 0.0, 40), np.array([1.0, 1.0, 0.0]))
