"""Terrain files: the same ground as from memory, and errors of a file in one sentence."""

import socket
from contextlib import closing
from itertools import pairwise

import numpy as np
import pytest

from startrack.core import Refused
from startrack.earth.geometry.scene import Terrain
from startrack.earth.terrain import Array, Grid, Mosaic, Pyramid, Raster, survey, up

from .scenes import mountains, random_rays

rasterio = pytest.importorskip("rasterio")

GRID, HEIGHTS = mountains()
SUN = up(np.array(0.3), np.array(0.5))


def write(path, heights, grid=GRID, crs="EPSG:4326", nodata=None, transform=None, unit=None):
    step = np.degrees(grid.step_x), np.degrees(grid.step_y)
    transform = transform or rasterio.Affine(
        step[0],
        0,
        np.degrees(grid.west) - step[0] / 2,
        0,
        -step[1],
        np.degrees(grid.north) + step[1] / 2,
    )
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=heights.shape[1],
        height=heights.shape[0],
        count=1,
        dtype=heights.dtype,
        crs=crs,
        transform=transform,
        nodata=nodata,
        tiled=True,
        blockxsize=256,
        blockysize=256,
    ) as file:
        file.write(heights, 1)
        if unit:
            file.set_band_unit(1, unit)
    return path


def flat(path, number, kind="float32", scale=1.0, offset=0.0, **options):
    """A file of one number, with scale and offset."""
    heights = np.full((16, 16), number, kind)
    grid = Grid(0.1, 0.8, 1e-4, 1e-4, 16, 16)
    with rasterio.open(write(path, heights, grid, **options), "r+") as file:
        file.scales, file.offsets = (scale,), (offset,)
    return path


def height_of(path):
    raster = Raster(path, heights=True)
    (value,) = np.unique(raster.read(Grid(0.1005, 0.7995, 1e-4, 1e-4, 4, 4)))
    lowest, highest, holes, _ = raster.extremes()
    assert lowest == highest == pytest.approx(value, rel=1e-6)
    assert holes == 0
    return float(value)


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


def test_scale_offset_and_unit_of_heights_are_applied(tmp_path):
    """300 m in numbers of other units; the foot and the US survey foot by NIST SP 811, B.6."""
    files = [
        flat(tmp_path / "plain.tif", 300),
        flat(tmp_path / "named.tif", 300, unit="metre"),
        flat(tmp_path / "dm.tif", 3000, "int16", 0.1),
        flat(tmp_path / "offset.tif", 4000, "uint16", 0.1, -100.0),
        flat(tmp_path / "km.tif", 0.3, unit="km"),
        flat(tmp_path / "ft.tif", 300 / 0.3048, unit="ft"),
        flat(tmp_path / "us.tif", 300 * 3937 / 1200, unit="US survey foot"),
        flat(tmp_path / "navd_ft.tif", 300 / 0.3048, crs="EPSG:4269+8228"),
        flat(tmp_path / "navd_us.tif", 300 * 3937 / 1200, crs="EPSG:4269+6360"),
        flat(tmp_path / "egm.tif", 300, crs="EPSG:4326+5773"),
    ]
    for path in files:
        assert height_of(path) == pytest.approx(300, abs=1e-3), path.name
    assert Raster(files[-1], heights=True).scaling.surface == "EGM96 height"
    # A map of something else keeps its numbers, in whatever unit.
    assert Raster(files[5]).read(GRID) is not None
    assert Raster(files[5]).scaling.scale == 1


def test_a_named_level_of_heights_and_the_geoid_of_a_scene_agree(tmp_path):
    """EPSG 5773 is EGM96, 4979 longitude, latitude and height above the ellipsoid of WGS84."""
    flat(tmp_path / "egm.tif", 300, crs="EPSG:4326+5773")
    flat(tmp_path / "wgs.tif", 300, crs="EPSG:4979")
    flat(tmp_path / "plain.tif", 300)
    with pytest.warns(UserWarning, match=r"egm.tif .*\(EGM96 height\), but terrain.geoid is not"):
        Terrain(("egm.tif",)).open(tmp_path)
    with pytest.raises(Refused, match=r"geoid must be left out, .*wgs.tif .*ellipsoid of WGS 84"):
        Terrain(("wgs.tif",), geoid="plain.tif").open(tmp_path)
    for name, geoid in (("egm", "plain.tif"), ("wgs", None), ("plain", "plain.tif")):
        Terrain((f"{name}.tif",), geoid=geoid).open(tmp_path)


def test_heights_that_can_be_read_two_ways_are_refused(tmp_path):
    odd = flat(tmp_path / "odd.tif", 300, unit="fathom")
    with pytest.raises(
        ValueError, match=r"unit of the heights of .* must be one of .* got 'fathom"
    ):
        Raster(odd, heights=True)
    both = flat(tmp_path / "both.tif", 300, unit="m", crs="EPSG:4269+6360")
    with pytest.raises(ValueError, match=r"must have one unit, got 'm' of the band and 'US survey"):
        Raster(both, heights=True)
    # New York's plane in US survey feet: its heights may be in feet or in metre.
    plane = {"crs": "EPSG:2263", "transform": rasterio.Affine(500, 0, 9.8e5, 0, -500, 2e5)}
    feet = flat(tmp_path / "plane.tif", 300, **plane)
    with pytest.raises(ValueError, match=r"must have a unit, as its eastings .* US survey foot"):
        Raster(feet, heights=True)
    assert Raster(flat(tmp_path / "said.tif", 300, unit="m", **plane), heights=True).scaling[
        :3
    ] == ((1.0, 0.0, "m"))
    assert Raster(feet).scaling[:2] == (1.0, 0.0)  # a map of something else
    deep = flat(tmp_path / "deep.tif", 300, crs="EPSG:4326+5715")
    with pytest.raises(ValueError, match=r"must have heights, got depths: MSL depth points down"):
        Raster(deep, heights=True)


def test_numbers_that_stand_for_no_height_are_not_taken_for_heights(tmp_path):
    """In files that do not name their fill value."""
    heights = np.full(HEIGHTS.shape, 700, np.int16)
    heights[80:120, 80:120] = -32768
    void = Raster(write(tmp_path / "void.tif", heights), heights=True)
    assert not void.extremes().of_the_earth
    with (
        pytest.warns(UserWarning, match="contains -32768"),
        pytest.raises(ValueError, match=r"must lie in \[-11100, 9100\] m, got -32768 m: declare"),
    ):
        void.read(GRID)
    heights[80:120, 80:120] = -9999
    deep = Raster(write(tmp_path / "deep.tif", heights), heights=True)
    assert not deep.extremes().of_the_earth
    with pytest.warns(UserWarning, match="contains -9999 and declares no number"):
        deep.read(GRID)
    # Also where the steps are so coarse that single numbers are smoothed away, or the unit is feet.
    heights[:] = 700
    heights[90, 90] = -9999
    coarse = Grid(GRID.west, GRID.north, 16 * GRID.step_x, 16 * GRID.step_y, 8, 8)
    feet = Raster(write(tmp_path / "feet.tif", heights, unit="ft"), heights=True)
    with pytest.warns(UserWarning, match="contains -9999"):
        feet.read(coarse)
    named = Raster(write(tmp_path / "named.tif", heights, nodata=-9999), heights=True)
    named.read(coarse)


def test_a_hole_is_no_sea(tmp_path):
    """A hole is refused, or has the given height; the sea is outside of the file."""
    heights = np.full(HEIGHTS.shape, 700, np.int16)
    heights[80:120, 80:120] = -32768
    source = Raster(write(tmp_path / "dem.tif", heights, nodata=-32768))
    rays = random_rays(GRID, 200, 70, 1200.0, 300.0)
    with pytest.raises(ValueError, match=r"holes must be given .*: \d+ rays meet ground"):
        Pyramid(Mosaic((source,))).meet(rays)
    filled = Pyramid(Mosaic((source,)), holes=650.0)
    hits, _ = filled.meet(rays)
    heights_met = hits.place[hits.hit, 2]
    assert (heights_met > -1).all()
    inside = source.covers(*hits.place[:, :2].T) & hits.hit
    assert inside.any()
    assert (hits.place[inside, 2] > 600).all()


def test_nothing_beside_the_file_is_read(tmp_path):
    """Side-car files with other numbers, overviews or masks change nothing."""
    path = flat(tmp_path / "dem.tif", 300)
    alone = Raster(path, heights=True)
    expected, grid = alone.read(alone.grid), alone.grid
    (tmp_path / "dem.tif.aux.xml").write_text(
        '<PAMDataset><PAMRasterBand band="1"><Scale>7</Scale><UnitType>ft</UnitType>'
        "<NoDataValue>300</NoDataValue></PAMRasterBand></PAMDataset>"
    )
    (tmp_path / "dem.tfw").write_text("1\n0\n0\n-1\n50\n50\n")
    for name in ("dem.tif.msk", "dem.tif.ovr"):
        write(tmp_path / name, np.zeros((16, 16), np.uint8))
    with rasterio.open(path) as file:  # without the options, GDAL reads them
        assert file.scales == (7.0,)
    beside = Raster(path, heights=True)
    assert beside.grid == grid
    assert beside.scaling == alone.scaling
    np.testing.assert_array_equal(beside.read(grid), expected)
    coarse = Grid(grid.west, grid.north, 4e-4, 4e-4, 4, 4)
    np.testing.assert_array_equal(beside.read(coarse), 300)


@pytest.mark.parametrize(
    "text",
    [
        '<VRTDataset rasterXSize="16" rasterYSize="16"><SRS>EPSG:4326</SRS><GeoTransform>0,1,0,0,0,'
        '-1</GeoTransform><VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename>'
        "{}</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>",
        '<GDAL_WMS><Service name="TMS"><ServerUrl>http://{}/${{z}}/${{x}}/${{y}}.png</ServerUrl>'
        "</Service><DataWindow><UpperLeftX>-180</UpperLeftX><UpperLeftY>90</UpperLeftY><LowerRightX>"
        "180</LowerRightX><LowerRightY>-90</LowerRightY><TileLevel>1</TileLevel></DataWindow>"
        "<Projection>EPSG:4326</Projection><BandsCount>1</BandsCount></GDAL_WMS>",
        "<WCS_GDAL><ServiceURL>http://{}/wcs?</ServiceURL><CoverageName>dem</CoverageName></WCS_GDAL>",
    ],
    ids=["VRT", "WMS", "WCS"],
)
def test_files_that_name_others_are_refused(tmp_path, text):
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        server.settimeout(0)
        address = f"127.0.0.1:{server.getsockname()[1]}"
        other = write(tmp_path / "other.tif", HEIGHTS) if "VRT" in text else address
        for name in ("dem.tif", "dem.vrt", "dem.xml"):
            (tmp_path / name).write_text(text.format(other))
            with pytest.raises(OSError, match=r"must be a raster file of GDAL's GTiff"):
                Raster(tmp_path / name)
        with pytest.raises(BlockingIOError):
            server.accept()


def test_overviews_that_stand_in_another_file_are_refused(tmp_path):
    """GDAL opens any file that the metadata of a TIFF name as its overviews."""
    path = flat(tmp_path / "dem.tif", 300)
    with rasterio.open(path, "r+") as file:
        file.update_tags(ns="OVERVIEWS", OVERVIEW_FILE="/vsicurl/http://127.0.0.1:9/x.tif")
    with pytest.raises(ValueError, match=r"dem.tif must not name other files, but has OVERVIEWS"):
        Raster(path)


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


def test_another_projection_keeps_its_pixels(tmp_path):
    """Of 30 m in UTM, which scales by 0.9996 to 1.0004 here, cells of 30 m in both directions."""
    transform = rasterio.Affine(30, 0, 600000, 0, -30, 5240000)
    heights = np.zeros((200, 200), np.float32)
    heights[::2] = 100.0  # ridges of one pixel from west to east
    raster = Raster(write(tmp_path / "utm.tif", heights, crs="EPSG:32632", transform=transform))
    grid = raster.grid
    middle = (grid.north + grid.south) / 2
    # Radii of curvature of WGS84 at 47.3 degrees: 6 370 km and 6 390 km.
    assert grid.step_y * 6.370e6 == pytest.approx(30, rel=0.002)
    assert grid.step_x * 6.390e6 * np.cos(middle) == pytest.approx(30, rel=0.002)
    assert np.nanstd(raster.read(grid)) > 15  # 0 on a grid of GDAL's choice would be half of it


def test_oblong_pixels_of_a_projection_are_not_smoothed(tmp_path):
    """A plane in UTM of pixels of 90 by 30 m, read in steps of 60 m: bilinear interpolation
    reproduces it."""
    easting = 90.0 * (np.arange(100) + 0.5)
    heights = np.repeat((easting / 10).astype(np.float32)[None], 300, 0)
    transform = rasterio.Affine(90, 0, 500000, 0, -30, 5240000)
    raster = Raster(write(tmp_path / "oblong.tif", heights, crs="EPSG:32632", transform=transform))
    radius = 0.9996 * 6389.7e3 * np.cos(np.radians(47.28))  # k0 times that of the parallel
    step = 60 / radius
    grid = type(GRID)(np.radians(9) + 10 * step, np.radians(47.28), step, 4e-6, 40, 2)
    expected = 0.1 * radius * step * np.arange(10, 50)
    assert raster.read(grid)[0] == pytest.approx(expected, abs=0.02)


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
