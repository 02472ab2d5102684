"""Terrain in tiles and levels: the same hits as in memory, and each tile is read once."""

import numpy as np
import pytest

from startrack.core.streams import Streams
from startrack.earth.terrain import (
    Array,
    Grid,
    HeightChart,
    Mosaic,
    Pyramid,
    Rays,
    fractal,
    index,
    read_charts,
    survey,
    up,
)

from .scenes import STEP, Relief, flat, globe, random_rays, ray

CELLS = 1300
GRID = Grid(np.radians(10.0), np.radians(47.0), STEP, STEP, CELLS + 1, CELLS + 1)
HEIGHTS = fractal(CELLS + 1, CELLS + 1, Streams(2, 0), 2500.0)
SUN = up(np.array(0.3), np.array(0.2))


@pytest.mark.parametrize("elevation", [85, 20])
def test_hits_do_not_depend_on_the_cache(elevation):
    rays = random_rays(GRID, 2000, elevation, 2500.0)
    whole = survey(Relief(index(GRID, HEIGHTS), 0.0), rays, SUN)
    for tiles in (2, 64):
        ground = Pyramid(Mosaic((Array(GRID, HEIGHTS),)), tiles=tiles)
        found = survey(ground, rays, SUN)
        np.testing.assert_array_equal(found.hit, whole.hit)
        np.testing.assert_allclose(found.distance, whole.distance, atol=1e-3)
        # A ray that comes in over the edge of the grid ends at its side, to a millimetre.
        top = np.abs(found.distance[whole.hit] - whole.distance[whole.hit]) < 1e-6
        assert top.mean() > 0.9
        mine, its = found.shadow[whole.hit], whole.shadow[whole.hit]
        np.testing.assert_array_equal(mine[top], its[top])


def test_a_pushbroom_reads_each_tile_once():
    """Lines from north to south; two rows of tiles fit into memory, the terrain has five by
    five."""
    cells = 5 * 128
    grid = Grid(0.1, 0.5, 4 * STEP, 4 * STEP, 4 * cells + 1, 4 * cells + 1)
    heights = np.kron(
        fractal(cells // 32, cells // 32, Streams(1, 0), 1000.0), np.ones((129, 129), np.float32)
    )[: 4 * cells + 1, : 4 * cells + 1]
    ground = Pyramid(Mosaic((Array(grid, heights),)), lowest=0, highest=1000, tiles=10)
    across = np.linspace(0.001, 0.999, 100) * 4 * cells
    for down in np.linspace(0.001, 0.999, 160) * 4 * cells:
        rays = ray(grid.west + across * grid.step_x, grid.north - down * grid.step_y, 500.0, 85)
        ground.meet(rays)
    assert len(ground.cache.touched) >= 25
    assert ground.cache.misses <= 1.2 * len(ground.cache.touched)
    assert ground.cache.memory < 10 * 513 * 513 * 4 * 1.38
    assert ground.cache.hits > 500


def test_the_level_follows_the_resolution_of_the_ray():
    ground = Pyramid(Mosaic((Array(GRID, HEIGHTS),)))
    rays = random_rays(GRID, 100, 85, 2500.0)
    cell = STEP * 6378137
    for ratio, level in ((0.0, 0), (0.5, 0), (1.1, 0), (2.2, 1), (9.0, 3), (1e6, 9)):
        some = Rays(rays.origin, rays.direction, np.full(100, ratio * cell / 3e5))
        assert set(ground.meet(some)[1]) == {level}


def test_a_level_is_the_mean_of_the_terrain_and_keeps_planes():
    plane = (np.arange(65) * 3.0 + np.arange(65)[:, None] * 2.0 + 100).astype(np.float32)
    array = Array(Grid(0.1, 0.5, STEP, STEP, 65, 65), plane)
    for level in range(6):
        inner = array.level(level)[0][1:-1, 1:-1]
        np.testing.assert_allclose(inner, plane[:: 2**level, :: 2**level][1:-1, 1:-1], rtol=1e-6)
    noise = np.random.default_rng(1).standard_normal((1025, 1025)).astype(np.float32)
    half, number = Array(Grid(0.1, 0.5, 1e-5, 1e-5, 1025, 1025), noise).level(1)
    assert number == 1
    # White noise keeps sum(w^2) of its variance: (1/16 + 1/4 + 1/16)^2 = 0.1406.
    assert half.var() / noise.var() == pytest.approx(0.1406, rel=0.02)


def test_the_best_source_counts_where_it_is():
    """A coarse map at a height of 100 m, a fine one at 300 m, a hole in the fine one, and the
    sea around."""
    country = Array(Grid(0.1, 0.5, 8 * STEP, 8 * STEP, 33, 33), np.full((33, 33), 100, np.float32))
    fine = np.full((65, 65), 300, np.float32)
    fine[30:35, 30:35] = np.nan
    area = Array(Grid(0.1 + 64.5 * STEP, 0.5 - 64.5 * STEP, STEP, STEP, 65, 65), fine)
    ground = Pyramid(Mosaic((country, area)), sea=-3.0)
    u = np.array([80.0, 96.5, 20.0, 300.0])  # in the area, in its hole, in the country, at sea
    hits, level = ground.meet(ray(0.1 + u * STEP, 0.5 - u * STEP, 0.0, 90))
    np.testing.assert_allclose(hits.place[:, 2], [300, 100, 100, -3], atol=1e-4)
    assert level[0] == 0
    assert level[2] == 3  # the country's own; nothing finer is there


def test_terrain_on_both_sides_of_the_date_line():
    """Two areas that meet at 180 degrees, one of them given with negative longitudes."""
    heights = np.full((41, 41), 50, np.float32)
    near = Array(Grid(np.pi - 40 * STEP, 0.2, STEP, STEP, 41, 41), heights)
    far = Array(Grid(-np.pi, 0.2, STEP, STEP, 41, 41), heights)
    mosaic = Mosaic((near, far))
    assert mosaic.grid.columns in (81, 82)
    lon = np.pi + np.linspace(-39, 39, 300) * STEP
    hits, _ = Pyramid(mosaic).meet(ray(lon, 0.2 - 20 * STEP, 50.0, 80, 1.0))
    np.testing.assert_allclose(hits.place[:, 2], 50, atol=1e-4)


def test_heights_above_the_geoid_and_where_the_geoid_is_missing():
    grid, heights = flat(200.0)
    around = Grid(grid.west - 0.1, grid.north + 0.1, 0.01, 0.01, 30, 30)
    geoid = Array(around, np.full((30, 30), 48.0, np.float32))
    rays = ray(grid.west + 20 * STEP, grid.north - 20 * STEP, 0.0, 90)
    ground = Pyramid(Mosaic((Array(grid, heights),)), geoid=geoid)
    assert ground.meet(rays)[0].place[0, 2] == pytest.approx(248, abs=1e-4)
    away = Array(Grid(2.0, 0.1, 0.01, 0.01, 30, 30), geoid.values)
    with pytest.raises(ValueError, match="geoid must cover all of the terrain"):
        Pyramid(Mosaic((Array(grid, heights),)), geoid=away).meet(rays)


def test_heights_beyond_their_bounds_are_refused():
    grid, heights = flat(200.0)
    ground = Pyramid(Mosaic((Array(grid, heights),)), highest=150.0)
    rays = ray(grid.west + 20 * STEP, grid.north - 20 * STEP, 0.0, 90)
    with pytest.raises(ValueError, match=r"heights must lie in \[-500, 150\]"):
        ground.meet(rays)
    with pytest.raises(ValueError, match="highest must be above lowest, got -500 and -500 metre"):
        Pyramid(ground.terrain, highest=-500.0)


def test_maps_lie_on_the_same_footing():
    """A linear albedo is read exactly; land cover keeps its classes; outside, the value is
    `absent`."""
    grid, heights = flat(0.0)
    ramp = np.broadcast_to(np.linspace(0, 1, 41, dtype=np.float32), (41, 41)).copy()
    cover = np.broadcast_to(np.arange(41, dtype=np.float32) // 20, (41, 41)).copy()
    charts = {
        "albedo": HeightChart(Mosaic((Array(grid, ramp),)), absent=0.06),
        "cover": HeightChart(Mosaic((Array(grid, cover),)), exact=True),
    }
    u = np.array([3.25, 19.4, 19.6, 77.0])
    rays = ray(grid.west + u * STEP, grid.north - 20.3 * STEP, 0.0, 90)
    ground = survey(Pyramid(Mosaic((Array(grid, heights),))), rays, SUN)
    maps = read_charts(ground, charts, STEP).maps
    np.testing.assert_allclose(maps["albedo"], [*(u[:3] / 40), 0.06], atol=1e-6)
    np.testing.assert_array_equal(maps["cover"], [0, 0, 1, np.nan])


def test_a_whole_earth_by_tiles_closes_at_the_date_line():
    grid, heights = globe(4.0)
    ground, whole = Pyramid(Mosaic((Array(grid, heights),)), tiles=8), index(grid, heights)
    assert ground.terrain.levels == 6  # 1440 columns can be halved five times
    for azimuth in (85, -85, 5):
        rays = ray(np.pi + np.linspace(-0.3, 0.3, 200), 0.05, 3000.0, 12, np.radians(azimuth), 4e5)
        found, expected = ground.meet(rays)[0], Relief(whole, 0.0).meet(rays)[0]
        np.testing.assert_array_equal(found.hit, expected.hit)
        hit = found.hit
        np.testing.assert_allclose(found.distance[hit], expected.distance[hit], atol=1e-5)
