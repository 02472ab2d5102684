"""Tiles of SRTM and the Copernicus DEM, by their names and layouts, of a real piece of terrain.

The terrain is Jacksboro Fault in Tennessee, three arc seconds of SRTM that matplotlib ships; it is
shifted by whole degrees and posts, so that corners of tiles lie in it.
"""

import re

import numpy as np
import pytest
from matplotlib.cbook import get_sample_data
from scipy.interpolate import RegularGridInterpolator

from startrack.cli.main import main
from startrack.core.units import deg
from startrack.earth.geometry.scene import Terrain
from startrack.earth.terrain import Rays, cartesian, survey, up

rasterio = pytest.importorskip("rasterio")

POSTS = 1200  # of a degree
VOID = -32768
WEST, NORTH = -84.41375 * POSTS + 0.5, 36.73291666666667 * POSTS - 0.5  # of the first post


def jacksboro(corner: bool) -> tuple[int, int, np.ndarray]:
    """West and north post of the terrain, and its heights; its middle at a corner of tiles."""
    with get_sample_data("jacksboro_fault_dem.npz") as file:
        heights = np.asarray(file["elevation"])
    west, north = round(WEST), round(NORTH)
    assert abs(WEST - west) < 1e-6
    assert abs(NORTH - north) < 1e-6
    if corner:
        west, north = -84 * POSTS - 200, 36 * POSTS + 170
    return west, north, heights


def srtm(folder, west: int, north: int, heights: np.ndarray) -> None:
    """N36W085.hgt and the like: 1201 posts, whose edges tiles share; big-endian, without header."""
    for south_deg, west_deg in corners(west, north, heights):
        tile = cut(west, north, heights, west_deg * POSTS, (south_deg + 1) * POSTS, 1201, 1201)
        path = folder / f"{side(south_deg, 'NS', 2)}{side(west_deg, 'EW', 3)}.hgt"
        path.write_bytes(tile.astype(">i2").tobytes())


def copernicus(folder, west: int, north: int, heights: np.ndarray, wide: int = 1) -> None:
    """Copernicus_DSM_COG_30_N36_00_W085_00_DEM.tif: 1200 posts, areas around them, no shared edge.

    wide  posts between columns, more than one north of 50 degrees
    """
    for south_deg, west_deg in corners(west, north, heights):
        first = west_deg * POSTS, (south_deg + 1) * POSTS
        tile = cut(west, north, heights, *first, 1200, 1200)[:, ::wide].astype(np.float32)
        place = f"{side(south_deg, 'NS', 2)}_00_{side(west_deg, 'EW', 3)}_00"
        across = wide / POSTS
        options = {
            "driver": "GTiff",
            "height": 1200,
            "width": tile.shape[1],
            "count": 1,
            "dtype": "float32",
            "crs": "EPSG:4326",
            "compress": "deflate",
            "nodata": VOID,
            "transform": rasterio.Affine(
                across, 0, west_deg - across / 2, 0, -1 / POSTS, south_deg + 1 + 0.5 / POSTS
            ),
        }
        path = folder / f"Copernicus_DSM_COG_30_{place}_DEM.tif"
        with rasterio.open(path, "w", **options) as file:
            file.write(tile, 1)


def corners(west: int, north: int, heights: np.ndarray) -> set[tuple[int, int]]:
    """South and west degree of each tile that holds a post."""
    rows, columns = heights.shape
    return {
        ((north - j - 1) // POSTS, (west + i) // POSTS)
        for j in (0, rows - 1)
        for i in (0, columns - 1)
    }


def cut(west, north, heights, first_west, first_north, rows, columns) -> np.ndarray:
    tile = np.full((rows, columns), VOID, np.int16)
    j, i = np.indices(heights.shape)
    j, i = j + first_north - north, i + west - first_west
    inside = (j >= 0) & (j < rows) & (i >= 0) & (i < columns)
    tile[j[inside], i[inside]] = heights[inside]
    return tile


def side(degree: int, letters: str, digits: int) -> str:
    return f"{letters[degree < 0]}{abs(degree):0{digits}d}"


def heights_below(terrain, longitude, latitude) -> np.ndarray:
    """Heights (metre above the ellipsoid) of the ground below places in degree."""
    longitude, latitude = longitude * deg, latitude * deg
    rise = up(longitude, latitude)
    rays = Rays(cartesian(longitude, latitude, np.full(len(rise), 9e3)), -rise, np.zeros(len(rise)))
    return survey(terrain, rays, up(np.array(-84 * deg), np.array(36 * deg))).height


def places(west, north, heights, count=400) -> tuple[np.ndarray, np.ndarray]:
    """Posts, points between them, and points along both edges of tiles, degree."""
    rng = np.random.default_rng(1)
    rows, columns = heights.shape
    x, y = rng.uniform(1, columns - 2, count), rng.uniform(1, rows - 2, count)
    x[: count // 4], y[: count // 4] = np.round(x[: count // 4]), np.round(y[: count // 4])
    x[count // 2 : 5 * count // 8] = 200 + rng.uniform(-1, 1, count // 8)
    y[5 * count // 8 : 6 * count // 8] = 170 + rng.uniform(-1, 1, count // 8)
    return (west + x) / POSTS, (north - y) / POSTS


def bilinear(west, north, heights, longitude, latitude, wide: int = 1) -> np.ndarray:
    """Between rows, and every so many columns, of the terrain itself; by scipy."""
    rows, columns = (np.arange(count) for count in heights.shape)
    at = RegularGridInterpolator((rows, columns[::wide]), heights[:, ::wide].astype(float))
    return at(np.stack([north - latitude * POSTS, longitude * POSTS - west], -1))


@pytest.mark.parametrize(
    ("write", "corner"),
    [
        pytest.param(srtm, False, id="srtm where it is"),
        pytest.param(srtm, True, id="srtm over four tiles", marks=pytest.mark.slow),
        pytest.param(copernicus, False, id="copernicus where it is", marks=pytest.mark.slow),
        pytest.param(copernicus, True, id="copernicus over four tiles", marks=pytest.mark.slow),
    ],
)
def test_tiles_are_the_terrain_that_they_were_cut_from(tmp_path, write, corner):
    """At posts, between them and along seams, within a centimetre."""
    west, north, heights = jacksboro(corner)
    write(tmp_path, west, north, heights)
    assert len(list(tmp_path.iterdir())) == (4 if corner else 1)
    terrain = Terrain(("*.hgt" if write is srtm else "*_DEM.tif",), lowest=-100).open(tmp_path)
    longitude, latitude = places(west, north, heights)
    found = heights_below(terrain, longitude, latitude)
    wanted = bilinear(west, north, heights, longitude, latitude)
    np.testing.assert_allclose(found, wanted, atol=0.01)


def test_tiles_of_two_widths_meet_at_50_degrees(tmp_path):
    """North of 50 degrees columns of the Copernicus DEM are wider; southern tiles keep theirs."""
    west, _, heights = jacksboro(corner=True)
    north = 50 * POSTS + 170
    copernicus(tmp_path, west, north - 170, heights[170:])
    copernicus(tmp_path, west, north, heights[:170], wide=2)
    terrain = Terrain(("*_N50_*", "*_N49_*"), lowest=-100).open(tmp_path)
    longitude, latitude = places(west, north, heights)
    found = heights_below(terrain, longitude, latitude)
    south, far = latitude < 50, latitude > 50 + 1 / POSTS  # between them the two are blended
    wanted = bilinear(west, north, heights, longitude, latitude)
    np.testing.assert_allclose(found[south], wanted[south], atol=0.01)
    wide = bilinear(west, north, heights, longitude, latitude, 2)
    seam = np.abs((longitude + 84) * POSTS) < 2  # where two wide tiles meet, the nearer post counts
    np.testing.assert_allclose(found[far & ~seam], wide[far & ~seam], atol=0.01)
    assert found.min() > heights.min() - 1  # no sea shows between tiles
    assert np.abs(wide - wanted).max() > 5


@pytest.mark.parametrize("form", ["tif", "gtx"])
def test_orthometric_heights_become_ellipsoidal(tmp_path, form):
    """A geoid of planes on the posts of EGM96, 15 minutes apart; longitudes from 0 in the gtx."""
    west, north, heights = jacksboro(corner=False)
    srtm(tmp_path, west, north, heights)
    first = -180.0 if form == "tif" else 0.0
    step, rows, columns = 0.25, 721, 1440
    lat, lon = 90 - step * np.arange(rows), first + step * np.arange(columns)
    lon = (lon + 180) % 360 - 180

    def undulation(longitude, latitude):
        return -30 + 2 * (latitude - 36) - 3 * (longitude + 84)

    grid = undulation(lon, lat[:, None]).astype(np.float32)
    path = tmp_path / f"us_nga_egm96_15.{form}"
    transform = rasterio.Affine(step, 0, first - step / 2, 0, -step, 90 + step / 2)
    if form == "gtx":
        head = np.array([-90, first, step, step], ">f8").tobytes()
        head += np.array([rows, columns], ">i4").tobytes()
        path.write_bytes(head + grid[::-1].astype(">f4").tobytes())
    else:
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            height=rows,
            width=columns,
            count=1,
            dtype="float32",
            crs="EPSG:4326",
            transform=transform,
        ) as file:
            file.write(grid, 1)
    terrain = Terrain(("*.hgt",), geoid=path.name, lowest=-100).open(tmp_path)
    longitude, latitude = places(west, north, heights, 160)
    found = heights_below(terrain, longitude, latitude)
    wanted = bilinear(west, north, heights, longitude, latitude)
    np.testing.assert_allclose(found, wanted + undulation(longitude, latitude), atol=0.01)


def test_the_command_names_what_tiles_cover(tmp_path, capsys):
    srtm(tmp_path, *jacksboro(corner=True))
    assert main(["earth", "terrain", str(tmp_path / "*.hgt")]) == 0
    said = capsys.readouterr().out
    assert len(re.findall(r"1201 x 1201 cells of 7\d\.\d x 92\.\d m", said)) == 4, said
    assert "longitude -85.0000 to -84.0000, latitude 36.0000 to 37.0000" in said
