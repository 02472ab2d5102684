"""Radiance at a sensor from tables of radiative transfer.

table     AirTable: radiance and transmission over wavelength and geometry, and its file.
sasktran  The one file that imports sasktran2: Mie scattering by mixtures of particles.
aerosol   Extinction over height, and scattering by particles, from type of aerosol and visibility.
gases     Transmittance of water vapour, ozone and mixed gases over air mass, and the Sun's
          spectrum.
solver    Radiance at sensors from particles and layers: sasktran2, wrapped.
build     New tables by sasktran2 and pvlib: AirTable, the first of two steps, and the Earth's
          limb.
bands     BandTable from AirTable and bands: every term as radiance in each band, from one
          altitude.
look_up   Radiance of each pixel from BandTable and viewing geometry: the second of the two steps.
cloud       Reflectance and transmission of a cloud layer, by doubling, with exact single
            scattering.
sunlight  Wavelengths -> irradiance of the Sun, as measured.
infrared  BandTable from InfraredTable and bands: thermal radiance and transmittance of the air.
radiance  At-sensor radiance in five terms, from the viewing geometry of pixels or from Ground.
runs      BandTable from runs of MODTRAN or libRadtran over three albedos.
modtran   Run from output of MODTRAN (.7sc, .tp7, .chn, JSON).
"""

from startrack.earth.atmosphere.aerosol import Haze
from startrack.earth.atmosphere.bands import BandTable, in_bands
from startrack.earth.atmosphere.build import Grid, build, build_limb
from startrack.earth.atmosphere.cloud import LayerLight, LayerOptics, layer_optics
from startrack.earth.atmosphere.infrared import (
    InfraredTable,
    infrared_bands,
    load_infrared,
    save_infrared,
    vacuum,
)
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
from startrack.earth.atmosphere.solver import TOP, solve_radiance
from startrack.earth.atmosphere.sunlight import sun_spectrum
from startrack.earth.atmosphere.table import Air, AirTable, load_table, save_table

# Public; the other imports serve other rooms.
__all__ = [
    "Air",
    "AirTable",
    "BandTable",
    "FineTable",
    "Grid",
    "Haze",
    "Heat",
    "InfraredTable",
    "LayerLight",
    "LayerOptics",
    "Reach",
    "Sight",
    "Terms",
    "at_sensor",
    "build",
    "build_limb",
    "heat_of",
    "in_bands",
    "infrared_bands",
    "layer_optics",
    "load_infrared",
    "load_table",
    "look_up",
    "planck",
    "radiance",
    "refine",
    "save_infrared",
    "save_table",
    "sight_of",
    "sun_spectrum",
    "vacuum",
]
