"""Intersections of rays and terrain on the WGS84 ellipsoid.

ellipsoid        Cartesian and geodetic coordinates on the ellipsoid WGS84, and back.
tile             Square tiles of heights, with the maxima and steepness of their blocks, cached in
                 memory.
surface          The one surface through heights on a grid that hits, normals and shadows use.
sources          Sources of heights and maps on a grid: GDAL rasters, arrays, fractal terrain from
                 a seed.
mosaic           One pyramid of tiles from sources of different resolution and extent, the best
                 source first.
ground           The values of an Earth scene: rays from a camera, and the ground that they meet.
path             The path of a straight ray over a grid, near one of its points: quadratic in the
                 distance.
march            The cell in which a ray first meets a surface: max-mip marching on curved paths.
horizon          Heights above which parallel rays, such as rays to the Sun, no longer meet a
                 surface.
bundle           Exact points and normals where rays meet a surface, for bundles of rays.
trace            Points and normals where rays meet a surface in memory; or only whether they meet
                 it.
constant_height  Points where rays meet a surface of constant height above the ellipsoid, such as
                 the sea.
scan             Points where rays meet a surface, by a search of every cell: the slow, simple
                 reference.
pyramid          Terrain of any size: each ray uses the level that its resolution needs.
survey           Ground from rays: what each ray meets, its illumination by the Sun, shadows, and
                 the values of the maps that accompany the terrain.
"""

from startrack.earth.terrain.constant_height import ConstantHeight
from startrack.earth.terrain.ellipsoid import EQUATORIAL, cartesian, geodetic, up
from startrack.earth.terrain.ground import Ground, Rays, between, joined, rays_down
from startrack.earth.terrain.mosaic import Mosaic
from startrack.earth.terrain.pyramid import Pyramid
from startrack.earth.terrain.scan import TerrainScan
from startrack.earth.terrain.sources import Array, Raster, Source, fractal, require_rasterio
from startrack.earth.terrain.surface import Grid, NorthUp, Surface, index
from startrack.earth.terrain.survey import LIFT, HeightChart, Intersector, read_charts, survey
from startrack.earth.terrain.trace import blocked, trace

# Public; the other imports serve other rooms.
__all__ = [
    "Array",
    "ConstantHeight",
    "Grid",
    "Intersector",
    "Mosaic",
    "Pyramid",
    "Rays",
    "cartesian",
    "fractal",
    "geodetic",
    "survey",
]
