"""Radiance at a sensor from tables of radiative transfer.

spectra   Irradiance of the Sun over wavelength.
table     AirTable: radiance and transmission over wavelength and geometry, and its file; AirTable
          and bands -> BandTable: every term as radiance in each band, from one altitude.
gases     AirTable with other columns of water vapour and ozone.
look_up   Radiance of each pixel from BandTable and viewing geometry: the second of the two steps.
cloud     Reflectance and transmission of a cloud layer, by doubling, with exact single scattering.
radiance_table  A user's table of the air, its file, and BandTable from it.
tape7     Output of MODTRAN -> rows of a user's table.
infrared  BandTable from InfraredTable and bands: thermal radiance and transmittance of the air.
radiance  At-sensor radiance in five terms, from the viewing geometry of pixels or from Ground.

The tables are built by the scripts in catalogs/atmosphere.
"""

from startrack.earth.atmosphere.cloud import LayerOptics, layer_optics
from startrack.earth.atmosphere.gases import with_gases
from startrack.earth.atmosphere.infrared import InfraredTable, infrared_bands, load_infrared, vacuum
from startrack.earth.atmosphere.look_up import FineTable, Reach, SlantPath, look_up, refine
from startrack.earth.atmosphere.radiance import (
    Terms,
    ThermalRadiance,
    at_sensor,
    heat_of,
    planck,
    radiance,
    sight_of,
)
from startrack.earth.atmosphere.radiance_table import (
    RadianceTable,
    load_radiance_table,
    load_user_table,
    radiance_bands,
)
from startrack.earth.atmosphere.spectra import edges_of, sun_spectrum
from startrack.earth.atmosphere.table import (
    SPREADS,
    Air,
    AirTable,
    BandTable,
    in_bands,
    load_table,
    mixed,
)
from startrack.earth.atmosphere.tape7 import RunGeometry, import_tape7

# Public; the other imports serve other rooms.
__all__ = [
    "Air",
    "RunGeometry",
    "Terms",
    "import_tape7",
    "load_radiance_table",
    "load_table",
    "sun_spectrum",
]
