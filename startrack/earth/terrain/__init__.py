"""Rays meet terrain on the WGS84 ellipsoid.

ellipsoid    Cartesian coordinates to geodetic ones and back, on the ellipsoid WGS84.
tile         Heights enter; square tiles of cells leave, with maxima and steepness, cached in
             memory.
surface      Heights at the vertices of a grid -> the one surface that hits, normals and shadows
             share.
sources      Sources of heights and maps on a grid: GDAL rasters, arrays, fractal terrain from a
             seed.
mosaic       Sources of different resolution and extent -> one pyramid of tiles, the best source
             first.
ground       The nouns of an Earth scene: the rays that look at it, and the ground that they see.
path         A straight ray -> its path over a grid, near one of its points: quadratic in the
             distance.
march        A ray and a surface -> the cell where they first meet: max-mip marching on curved
             paths.
bundle       Rays enter in bundles; the exact points and normals where they meet a surface leave.
trace        Rays and a surface -> where they meet it, and with which normal; or only whether they
             do.
level        Rays -> where they meet the surface of one height above the ellipsoid: sea, or no
             terrain.
scan         Rays and heights -> where they meet, by a search of every cell: slow, simple, the
             reference.
intersector  What can be asked of any ground: where rays meet it, and which rays it stops.
pyramid      Terrain of any size -> Hits: each ray on the level that its resolution needs, tile by
             tile.
chart        Maps that accompany the terrain (albedo, temperature, land cover) -> values on the
             ground.
survey       Rays and ground -> Ground: what each ray sees, how the sun stands there, and what
             hides it.
"""

from startrack.earth.terrain.chart import Chart, read_charts
from startrack.earth.terrain.ellipsoid import EQUATORIAL, cartesian, geodetic, up
from startrack.earth.terrain.ground import Ground, Rays
from startrack.earth.terrain.intersector import Intersector, Level, Relief, Scan
from startrack.earth.terrain.mosaic import Mosaic
from startrack.earth.terrain.pyramid import Pyramid
from startrack.earth.terrain.sources import Array, Raster, Source, fractal
from startrack.earth.terrain.surface import Grid, Surface, index
from startrack.earth.terrain.survey import survey
from startrack.earth.terrain.trace import trace

# Public; the other imports serve other rooms.
__all__ = [
    "Array",
    "Chart",
    "Grid",
    "Ground",
    "Intersector",
    "Level",
    "Mosaic",
    "Pyramid",
    "Raster",
    "Rays",
    "Relief",
    "Scan",
    "Source",
    "Surface",
    "cartesian",
    "fractal",
    "geodetic",
    "index",
    "read_charts",
    "survey",
    "up",
]
