"""The march against a search of every cell, and against surfaces with a closed form."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from startrack.earth.terrain import (
    ConstantHeight,
    Grid,
    Rays,
    TerrainScan,
    cartesian,
    geodetic,
    index,
)
from startrack.earth.terrain.horizon import FEWEST, with_horizon
from startrack.earth.terrain.trace import blocked, go_on, trace, waiting

from .scenes import STEP, Relief, axes, flat, globe, hills, mountains, random_rays, ray

RUGGED = Path(__file__).parents[2] / "oracle" / "rugged.json"

GRID, HEIGHTS = mountains()


@cache
def relief():
    return index(GRID, HEIGHTS)


@pytest.mark.parametrize("elevation", [pytest.param(85, marks=pytest.mark.slow), 60, 30, 10, 2])
def test_hits_are_those_of_the_search(elevation):
    rays = random_rays(GRID, 1000, elevation, HEIGHTS.max())
    found = trace(relief(), rays)
    expected, _ = TerrainScan(GRID, HEIGHTS, 2.8e5, 3.2e5).meet(rays)
    np.testing.assert_array_equal(found.hit, expected.hit)
    hit = found.hit
    error = np.abs(found.distance[hit] - expected.distance[hit])
    assert np.median(error) < 1e-6
    assert error.max() < 0.05  # where a ray comes in over the edge of the grid
    same = np.flatnonzero(hit)[error < 1e-7]
    np.testing.assert_allclose(found.normal[same], expected.normal[same], atol=1e-8)


def test_a_hit_lies_on_the_ray_and_on_the_surface():
    """Heights that are linear in longitude and latitude, compared with the formula."""
    grid, heights = flat()
    heights += (np.arange(41) * 8 + np.arange(41)[:, None] * 4).astype(np.float32)
    rays = random_rays(grid, 200, 70, 260, 220)
    found = trace(index(grid, heights), rays)
    assert found.hit.all()
    point = rays.origin + found.distance[:, None] * rays.direction
    longitude, latitude, height = geodetic(point)
    np.testing.assert_allclose(found.place, np.stack([longitude, latitude, height], -1), atol=1e-9)
    plane = (longitude - grid.west) / STEP * 8 + (grid.north - latitude) / STEP * 4
    np.testing.assert_allclose(height, plane, atol=2e-8)


def test_normals_are_those_of_the_slope():
    """A cell rises by 8 m to the east and 4 m to the south, over its sides on the ellipsoid."""
    grid, heights = flat()
    heights += (np.arange(41) * 8 + np.arange(41)[:, None] * 4).astype(np.float32)
    found = trace(index(grid, heights), random_rays(grid, 50, 80, 400))
    for place, normal in zip(found.place, found.normal, strict=True):
        east, north, rise = axes(place[0], place[1])
        around = cartesian(
            place[0] + np.array([STEP, 0, 0]),
            place[1] + np.array([0, STEP, 0]),
            np.full(3, place[2]),
        )
        width, depth = np.linalg.norm(around[:2] - around[2], axis=1)
        slope = rise - 8 / width * east + 4 / depth * north
        np.testing.assert_allclose(normal, slope / np.linalg.norm(slope), atol=1e-6)


@pytest.mark.parametrize("height", [0.0, 9000.0, -400.0])
def test_flat_terrain_is_the_surface_of_its_height(height):
    grid, heights = flat(height)
    rays = random_rays(grid, 300, 35, height, height)
    found, expected = trace(index(grid, heights), rays), ConstantHeight(height).meet(rays)[0]
    np.testing.assert_allclose(found.distance, expected.distance, rtol=0, atol=2e-8)
    np.testing.assert_allclose(expected.place[:, 2], height, atol=1e-8)


def test_rays_that_look_straight_down_or_up():
    grid, heights = mountains(60)
    surface = index(grid, heights)
    down = ray(grid.west + 30.5 * STEP, grid.north - 20.25 * STEP, 0.0, 90.0)
    found = trace(surface, down)
    i, j = 30, 20
    expected = heights[j : j + 2, i : i + 2].astype(float).mean(axis=1) @ [0.75, 0.25]
    assert found.place[0, 2] == pytest.approx(expected, abs=1e-6)
    assert not trace(surface, Rays(down.origin, -down.direction, down.spread)).hit.any()


def test_a_camera_within_the_shell_of_the_terrain():
    """On a slope among mountains, looking level and upwards, above the ground and below it."""
    lon, lat = GRID.west + 100 * STEP, GRID.north - 100 * STEP
    east, north, rise = axes(lon, lat)
    around = np.radians(np.arange(0, 360, 5))
    view = np.cos(around)[:, None] * east + np.sin(around)[:, None] * north + 0.12 * rise
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    eye = cartesian(np.array(lon), np.array(lat), np.array(float(HEIGHTS[100, 100]) + 5))
    rays = Rays(np.tile(eye, (72, 1)), view, np.zeros(72))
    found = trace(relief(), rays)
    expected, _ = TerrainScan(GRID, HEIGHTS, 0.0, 2e4).meet(rays)
    assert 5 < expected.hit.sum() < 72
    np.testing.assert_array_equal(found.hit, expected.hit)
    hit = found.hit
    np.testing.assert_allclose(found.distance[hit], expected.distance[hit], atol=1e-3)
    buried = trace(relief(), Rays(rays.origin - 50 * rise, view, rays.spread))
    np.testing.assert_array_equal(buried.distance, 0.0)


@pytest.mark.parametrize("slope", [3, 12, 30, 60])
def test_rays_that_rise_are_stopped_where_the_search_stops_them(slope):
    """Rays start above, on and below the surface, in holes, and at the sides of the grid."""
    grid, heights = mountains(96)
    heights = heights * np.float32(0.3)
    random = np.random.default_rng(slope)
    holes = random.integers(2, 94, (2, 40))
    heights[holes[0], holes[1]] = np.nan
    u, v = random.uniform(-4, 100, (2, 1500))
    lift = random.choice([-40.0, -1.0, 0.5, 5.0, 50.0], 1500)
    near = heights[np.clip(v, 0, 96).astype(int), np.clip(u, 0, 96).astype(int)]
    place = cartesian(grid.west + u * STEP, grid.north - v * STEP, np.nan_to_num(near) + lift)
    east, north, rise = axes(grid.west + 48 * STEP, grid.north - 48 * STEP)
    e, a = np.radians(slope), random.uniform(0, 2 * np.pi, (1500, 1))
    view = np.cos(e) * (np.sin(a) * east + np.cos(a) * north) + np.sin(e) * rise
    rays = Rays(place, view, np.zeros(1500))
    found, expected = (
        trace(index(grid, heights), rays),
        TerrainScan(grid, heights, 0.0, 9e3).meet(rays)[0],
    )
    assert 100 < expected.hit.sum() < 1400
    # A corner of a hole that is cut by less than a path's tolerance may be missed.
    assert (found.hit != expected.hit).sum() <= 2
    assert (blocked(index(grid, heights), rays, 0.0) != expected.hit).sum() <= 2
    both = found.hit & expected.hit
    error = np.abs(found.distance[both] - expected.distance[both])
    assert np.percentile(error, 99) < 1e-6
    assert error.max() < 1e-2


def test_a_ray_over_the_edge_ends_at_its_side():
    """Level terrain 500 m high whose sides reach down to 0: the side is a plane or a cone."""
    grid, heights = flat(500.0)
    heights[20, 20] = 0
    rays = ray(
        grid.west + np.linspace(-80, 30, 60) * STEP,
        grid.north - 15.3 * STEP,
        400.0,
        12,
        np.radians(-70),
    )
    found = trace(index(grid, heights), rays)
    expected, _ = TerrainScan(grid, heights, 2.9e5, 3.1e5).meet(rays)
    np.testing.assert_array_equal(found.hit, expected.hit)
    assert 5 < (found.place[:, 2] < 499).sum() < found.hit.sum()
    np.testing.assert_allclose(found.distance, expected.distance, rtol=0, atol=1e-7)


def test_a_cliff_of_two_kilometres_in_one_cell():
    grid, heights = flat()
    heights[:, 20:] = 2000.0
    surface = index(grid, heights)
    for azimuth in (-90, 90):
        rays = ray(
            grid.west + np.linspace(15, 25, 300) * STEP,
            grid.north - 20.3 * STEP,
            900.0,
            20,
            np.radians(azimuth),
        )
        expected, _ = TerrainScan(grid, heights, 2.9e5, 3.1e5).meet(rays)
        np.testing.assert_allclose(trace(surface, rays).distance, expected.distance, atol=1e-6)


def test_terrain_of_one_cell():
    grid = Grid(np.radians(10.0), np.radians(47.0), STEP, STEP, 2, 2)
    heights = np.array([[0, 40], [20, 0]], np.float32)
    inside = ray(grid.west + 0.25 * STEP, grid.north - 0.5 * STEP, 12.5, 60)
    outside = ray(grid.west + 1.25 * STEP, grid.north - 0.5 * STEP, 0.0, 89)
    surface = index(grid, heights)
    assert trace(surface, inside).place[0, 2] == pytest.approx(12.5, abs=1e-6)
    assert not trace(surface, outside).hit[0]
    assert Relief(surface, 0.0).meet(outside)[0].place[0, 2] == pytest.approx(0, abs=1e-6)


def test_rays_fall_through_holes_and_meet_what_is_behind():
    grid, heights = flat(500.0)
    heights[18:23, 18:23] = np.nan
    heights[0, 0] = 0  # the body of the terrain reaches down to its lowest height
    surface = index(grid, heights)
    down = ray(grid.west + 20 * STEP, grid.north - 20 * STEP, 500.0, 90)
    assert not trace(surface, down).hit[0]
    # At 45 degrees the ray passes the hole and comes against the terrain's side, from within.
    rays = ray(grid.west + 20 * STEP, grid.north - 20 * STEP, 500.0, 45, np.radians(90))
    found, (expected, _) = trace(surface, rays), TerrainScan(grid, heights, 2.9e5, 3.1e5).meet(rays)
    assert found.hit[0]
    assert found.distance[0] == pytest.approx(expected.distance[0], abs=1e-3)
    assert found.place[0, 2] < 499


@pytest.mark.parametrize("cells", [1, 40, 511, 512, 513])
def test_tiles_join_without_a_seam(cells):
    grid = Grid(0.1, 0.1, STEP, STEP, cells + 1, 3)
    heights = np.full((3, cells + 1), 100.0, np.float32)
    u = np.linspace(0.01, cells - 0.01, 500)
    rays = ray(grid.west + u * STEP, grid.north - STEP, 100.0, 90)
    np.testing.assert_allclose(trace(index(grid, heights), rays).place[:, 2], 100.0, atol=1e-7)


def test_the_date_line_is_a_place_like_others():
    """The same terrain, with its edge at 180 degrees and 40 degrees east of it, seen along the
    equator."""
    grid, heights = globe()
    turned = Grid(grid.west + np.radians(40), grid.north, grid.step_x, grid.step_y, 360, 180)
    rays = ray(np.pi + np.linspace(-0.3, 0.3, 500), 0.05, 3000.0, 12, np.radians(85), 4e5)
    one = trace(index(grid, heights), rays)
    other = trace(index(turned, np.roll(heights, -40, axis=1)), rays)
    assert one.hit.all()
    np.testing.assert_allclose(one.distance, other.distance, atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_pole_is_a_place_like_others(sign):
    """Rays down to points within 200 km of the pole, and to the pole itself: the search agrees."""
    grid, heights = globe()
    random = np.random.default_rng(3)
    lat = sign * (np.pi / 2 - np.append(0.03 * random.random(100), 0.0))
    lon = np.append(random.uniform(-np.pi, np.pi, 100), 0.0)
    rays = ray(lon, lat, 3000.0, 90)
    found = trace(index(grid, heights), rays)
    assert found.hit.all()
    ring = heights[0 if sign > 0 else -1]
    assert found.place[-1, 2] == pytest.approx(ring.astype(float).mean(), abs=1e-2)
    shell = ConstantHeight(float(ring.mean())).meet(rays)[0]
    assert np.abs(found.distance - shell.distance).max() < 2 * np.ptp(ring)


def test_a_wrong_shape_or_value_is_refused():
    grid, heights = flat()
    with pytest.raises(ValueError, match=r"heights must have the shape of their grid"):
        index(grid, heights[:-1])
    with pytest.raises(ValueError, match="heights must be finite or NaN"):
        index(grid, np.full_like(heights, np.nan))
    heights[3, 3] = np.inf
    with pytest.raises(ValueError, match="heights must be finite or NaN"):
        index(grid, heights)
    with pytest.raises(ValueError, match="between the poles"):
        Grid(0.0, 1.6, STEP, STEP, 10, 10)
    with pytest.raises(ValueError, match="full turn"):
        Grid(0.0, 1.0, 0.1, 0.1, 64, 10)


@pytest.mark.parametrize("case", json.loads(RUGGED.read_text()), ids=lambda c: c["elevation_deg"])
def test_hits_are_those_of_rugged(case):
    """Orekit's Rugged 4.0.1, which uses the same bilinear surface on the same ellipsoid."""
    grid, heights = hills()
    rays = Rays(np.array(case["origin"]), np.array(case["direction"]), np.zeros(40))
    found, expected = trace(index(grid, heights), rays).place, np.array(case["place"])
    metres = np.linalg.norm(cartesian(*found.T) - cartesian(*expected.T), axis=1)
    assert metres.max() < 1e-6


@pytest.mark.parametrize("azimuth", [0.0, 0.7, 2.5, 4.0, 5.5])
def test_shadows_with_a_horizon_are_those_of_each_ray(azimuth):
    """Parallel rays to a low Sun, from mountains with a hole, with and without the horizon."""
    heights = HEIGHTS.copy()
    heights[80:90, 60:75] = np.nan
    surface = index(GRID, heights)
    down = random_rays(GRID, FEWEST + 1000, 80, HEIGHTS.max(), 0.9)
    found = trace(surface, down)
    point = (down.origin + found.distance[:, None] * down.direction)[found.hit]
    east, north, rise = axes(GRID.west, GRID.north)
    side = np.sin(azimuth) * east + np.cos(azimuth) * north
    for elevation in np.radians([20, 8, 2]):
        sun = np.cos(elevation) * side + np.sin(elevation) * rise
        rays = Rays(point, np.broadcast_to(sun, point.shape).copy(), np.zeros(len(point)))
        assert with_horizon(surface, rays).horizon.bound.size
        hits = waiting(len(rays), 1e-3)
        go_on(surface, rays.origin, rays.direction, hits, False)
        np.testing.assert_array_equal(blocked(surface, rays, 1e-3), hits.hit)
