"""The Earth as a scene, its geometry: rays and terrain become the ground that each ray sees.

ellipsoid    Cartesian and geodetic coordinates on WGS84
ground       Rays and Ground: the nouns that flow
tile         heights in square tiles, with the maxima of their blocks
surface      Grid, and the bilinear surface through its heights
path         a straight ray as a curve over the grid
march        the nearest point where a ray meets the surface
trace        march for many rays, with normals; or only whether they meet
level        the surface of one height: sea, ellipsoid; tangent height of what misses
scan         the reference: a search of every cell
intersector  the grounds that can be asked: Level, Relief, Scan
survey       Rays -> Ground: with sun, shadow and sky
fractal      terrain from a seed
"""

from startrack.scene.earth.ellipsoid import cartesian, geodetic, up
from startrack.scene.earth.fractal import fractal
from startrack.scene.earth.ground import Ground, Rays
from startrack.scene.earth.intersector import Intersector, Level, Relief, Scan
from startrack.scene.earth.surface import Grid, index
from startrack.scene.earth.survey import survey

__all__ = [
    "Grid",
    "Ground",
    "Intersector",
    "Level",
    "Rays",
    "Relief",
    "Scan",
    "cartesian",
    "fractal",
    "geodetic",
    "index",
    "survey",
    "up",
]
