"""The Earth as a scene, its geometry: rays and terrain become the ground that each ray sees.

ellipsoid    Cartesian and geodetic coordinates on WGS84
ground       Rays and Ground: the nouns that flow
tile         heights in square tiles, with the maxima of their blocks
surface      Grid, and the bilinear surface through its heights
path         a straight ray as a curve over the grid
march        the cell in which a ray first meets the surface
polish       the exact point in that cell, and the normal
bundle       path and polish for many rays at a time
trace        all three for any number of rays; or only whether they meet
level        the surface of one height: sea, ellipsoid; tangent height of what misses
scan         the reference: a search of every cell
intersector  the grounds that can be asked: Level, Relief, Scan
survey       Rays -> Ground: with sun, shadow and sky
source       anything that gives values at vertices: Array
raster       a GeoTIFF as a source
mosaic       sources of different resolution and extent as one pyramid of tiles
cache        a bounded number of tiles in memory
pyramid      terrain of any size, each ray on the level that it needs
chart        albedo, temperature or land cover on the ground
aircraft     Aircraft: level flight
orbit        Orbit, TwoLines: where a satellite is, and where the Sun
sensor       matrix, line, staggered and TDI elements; the dating of lines
sight        a camera in flight -> Rays
parameters   EarthScene: a scene file
image        EarthScene -> the ground of each line
fractal      terrain from a seed
"""

from startrack.scene.earth.aircraft import Aircraft
from startrack.scene.earth.chart import Chart, read_charts
from startrack.scene.earth.ellipsoid import cartesian, geodetic, up
from startrack.scene.earth.fractal import fractal
from startrack.scene.earth.ground import Ground, Rays
from startrack.scene.earth.image import Strip, observe_earth
from startrack.scene.earth.intersector import Intersector, Level, Relief, Scan
from startrack.scene.earth.mosaic import Mosaic
from startrack.scene.earth.orbit import Carrier, Flight, Orbit, TwoLines, fly, sun_direction
from startrack.scene.earth.parameters import EarthScene, Fractal, MapFile, Sensor, Terrain
from startrack.scene.earth.pyramid import Pyramid
from startrack.scene.earth.raster import Raster
from startrack.scene.earth.sensor import (
    Dating,
    Elements,
    line_elements,
    matrix_elements,
    staggered_elements,
    tdi_elements,
)
from startrack.scene.earth.sight import Fixed, Pointing, ground_rate, scan_lines, sight
from startrack.scene.earth.source import Array, Source
from startrack.scene.earth.surface import Grid, Surface, index
from startrack.scene.earth.survey import survey

__all__ = [
    "Aircraft",
    "Array",
    "Carrier",
    "Chart",
    "Dating",
    "EarthScene",
    "Elements",
    "Fixed",
    "Flight",
    "Fractal",
    "Grid",
    "Ground",
    "Intersector",
    "Level",
    "MapFile",
    "Mosaic",
    "Orbit",
    "Pointing",
    "Pyramid",
    "Raster",
    "Rays",
    "Relief",
    "Scan",
    "Sensor",
    "Source",
    "Strip",
    "Surface",
    "Terrain",
    "TwoLines",
    "cartesian",
    "fly",
    "fractal",
    "geodetic",
    "ground_rate",
    "index",
    "line_elements",
    "matrix_elements",
    "observe_earth",
    "read_charts",
    "scan_lines",
    "sight",
    "staggered_elements",
    "sun_direction",
    "survey",
    "tdi_elements",
    "up",
]
