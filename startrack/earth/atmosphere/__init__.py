"""Radiance at a sensor from tables of radiative transfer.

aerosol   Extinction over height, and scattering by particles, from type of aerosol and visibility;
          the one file that imports sasktran2.
spectra   Transmittance of gases over air mass, and irradiance of the Sun, over wavelength.
table     AirTable: radiance and transmission over wavelength and geometry, and its file; BandTable
          from it and bands: every term as radiance in each band, from one altitude.
spread    From how far the ground's light reaches a line of sight through air: photon paths,
          Gaussians.
build     Radiance at sensors by sasktran2, and new tables by it: AirTable and the Earth's limb.
look_up   Radiance of each pixel from BandTable and viewing geometry: the second of the two steps.
cloud     Reflectance and transmission of a cloud layer, by doubling, with exact single scattering.
infrared  BandTable from InfraredTable and bands: thermal radiance and transmittance of the air.
radiance  At-sensor radiance in five terms, from the viewing geometry of pixels or from Ground.
"""

from startrack.earth.atmosphere.build import TOP, Grid, build, build_limb, solve_radiance
from startrack.earth.atmosphere.cloud import LayerOptics, layer_optics
from startrack.earth.atmosphere.infrared import InfraredTable, infrared_bands, load_infrared, vacuum
from startrack.earth.atmosphere.look_up import FineTable, Reach, Sight, look_up, refine
from startrack.earth.atmosphere.radiance import (
    Heat,
    Terms,
    at_sensor,
    heat_of,
    planck,
    radiance,
    sight_of,
)
from startrack.earth.atmosphere.spectra import sun_spectrum
from startrack.earth.atmosphere.spread import SPREADS
from startrack.earth.atmosphere.table import (
    Air,
    AirTable,
    BandTable,
    in_bands,
    load_table,
    mixed,
    save_table,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Air",
    "AirTable",
    "BandTable",
    "FineTable",
    "Grid",
    "Heat",
    "Reach",
    "Sight",
    "Terms",
    "at_sensor",
    "build",
    "in_bands",
    "load_table",
    "look_up",
    "radiance",
    "refine",
    "sun_spectrum",
]
