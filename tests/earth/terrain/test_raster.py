"""Terrain files: the same ground as from memory, and what is wrong with a file in a sentence."""

from itertools import pairwise

import numpy as np
import pytest

from startrack.earth.terrain import Array, Mosaic, Pyramid, Raster, survey, up

from .scenes import mountains, random_rays

rasterio = pytest.importorskip("rasterio")

GRID, HEIGHTS = mountains()
SUN = up(np.array(0.3), np.array(0.5))


def write(path, heights, grid=GRID, crs="EPSG:4326", nodata=None, transform=None):
    step = np.degrees(grid.step_x), np.degrees(grid.step_y)
    transform = transform or rasterio.Affine(
        step[0], 0, np.degrees(grid.west) - step[0] / 2,
        0, -step[1], np.degrees(grid.north) + step[1] / 2,
    )  # fmt: skip
    with rasterio.open(
        path, "w", driver="GTiff", width=heights.shape[1], height=heights.shape[0], count=1,
        dtype=heights.dtype, crs=crs, transform=transform, nodata=nodata, tiled=True,
        blockxsize=256, blockysize=256,
    ) as file:  # fmt: skip
        file.write(heights, 1)
    return path


def test_a_file_is_the_same_ground_as_its_array(tmp_path):
    raster = Raster(write(tmp_path / "dem.tif", HEIGHTS))
    assert raster.grid.columns == GRID.columns
    assert raster.grid.west == pytest.approx(GRID.west, abs=1e-15)
    np.testing.assert_allclose(raster.read(GRID), HEIGHTS, atol=2e-3)
    rays = random_rays(GRID, 500, 70, 1200.0, 300.0)
    from_file, from_array = (
        survey(Pyramid(Mosaic((one,))), rays, SUN) for one in (raster, Array(GRID, HEIGHTS))
    )
    np.testing.assert_array_equal(from_file.hit, from_array.hit)
    assert np.median(np.abs(from_file.distance - from_array.distance)) < 1e-3
    assert (from_file.shadow != from_array.shadow).mean() < 0.01


def test_no_data_is_a_hole_that_the_sea_fills(tmp_path):
    heights = np.round(HEIGHTS + 10).astype(np.int16)
    heights[80:120, 80:120] = -32768
    raster = Raster(write(tmp_path / "dem.tif", heights, nodata=-32768))
    values = raster.read(GRID)
    assert np.isnan(values[82:118, 82:118]).all()
    assert np.isfinite(values[:78]).all()


def test_coarser_steps_are_means(tmp_path):
    """The noise of single pixels falls by what GDAL's smoothing kernel keeps, about 1 / level."""
    noise = np.random.default_rng(1).standard_normal(HEIGHTS.shape).astype(np.float32)
    raster = Raster(write(tmp_path / "noise.tif", noise))
    ground = Mosaic((raster,))
    spread = [np.nanstd(ground.read(level, 0, 0)) for level in range(4)]
    assert spread[0] == pytest.approx(1, rel=0.05)
    for finer, coarser in pairwise(spread):
        assert coarser < 0.75 * finer


def test_another_projection_is_warped(tmp_path):
    """A plane in UTM zone 32, whose height is the easting over 1000."""
    easting = 500000 + 30.0 * (np.arange(300) + 0.5)
    heights = np.broadcast_to((easting / 1000).astype(np.float32), (300, 300)).copy()
    transform = rasterio.Affine(30, 0, 500000, 0, -30, 5200000)
    raster = Raster(write(tmp_path / "utm.tif", heights, crs="EPSG:32632", transform=transform))
    lon = np.radians(9.0 + 0.05)
    grid = type(GRID)(lon, np.radians(46.92), 1e-6, 1e-6, 2, 2)
    # 0.05 degree east of the central meridian: k0 N cos(lat) dlon to first order.
    expected = 500 + 0.9996 * 6389.5 * np.cos(np.radians(46.92)) * (lon - np.radians(9.0))
    assert raster.read(grid)[0, 0] == pytest.approx(expected, abs=0.01)


def test_files_that_cannot_serve(tmp_path):
    with pytest.raises(OSError, match=r"none.tif must be a raster file"):
        Raster(tmp_path / "none.tif")
    text = tmp_path / "text.tif"
    text.write_text("no raster")
    with pytest.raises(OSError, match=r"text.tif must be a raster file"):
        Raster(text)
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        bare = write(tmp_path / "bare.tif", HEIGHTS, crs=None, transform=rasterio.Affine.identity())
    with pytest.raises(ValueError, match=r"bare.tif must have a georeference"):
        Raster(bare)
    engineering = 'LOCAL_CS["a yard",UNIT["metre",1]]'
    yard = write(tmp_path / "yard.tif", HEIGHTS, crs=engineering)
    with pytest.raises(ValueError, match=r"yard.tif must have a coordinate system that PROJ knows"):
        Raster(yard)
    with pytest.raises(ValueError, match=r"band of .* must lie in \[1, 1\], got 2"):
        Raster(write(tmp_path / "dem.tif", HEIGHTS), band=2)


def test_a_truncated_file_is_named(tmp_path):
    path = write(tmp_path / "cut.tif", HEIGHTS)
    path.write_bytes(path.read_bytes()[:60000])
    with pytest.raises(OSError, match=r"cut.tif must be a"):
        Raster(path).read(GRID)


def test_without_rasterio_there_is_a_sentence(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(ImportError, match=r"rasterio must be installed"):
        Raster(tmp_path / "dem.tif")
