"""Radiance at a sensor from tables of radiative transfer.

table     AirTable: radiance and transmission over wavelength and geometry, and its file.
sasktran  The one file that imports sasktran2: Mie scattering by mixtures of particles.
aerosol   Type of aerosol and visibility -> extinction over height, and how one particle scatters.
gases     Wavelength and air mass -> what water, ozone and mixed gases let through, and the Sun
          itself.
solver    sasktran2, wrapped: particles and layers -> radiance at sensors.
build     Air -> AirTable, through sasktran2 and pvlib: the first of the two steps.
bands     AirTable and bands -> BandTable: every term as energy in each band, seen from one
          altitude.
look_up   BandTable and where each pixel looks -> radiance of each pixel: the second of the two
          steps.
infrared  InfraredTable and bands -> BandTable: heat of the air and what it lets through.
radiance  Where each pixel looks and what is there enter; at-sensor radiance in five terms leaves.
runs      Runs of MODTRAN or libRadtran over three albedos enter; a BandTable leaves.
modtran   Output of MODTRAN (.7sc, .tp7, .chn, JSON) -> Run.
limb      Radiative transfer in spherical layers enters; the table of the Earth's bright limb
          leaves.
view      Ground -> Terms: what an Earth image's rays see, through the air.
"""

from startrack.earth.atmosphere.bands import BandTable, in_bands
from startrack.earth.atmosphere.build import Grid, build
from startrack.earth.atmosphere.infrared import (
    InfraredTable,
    infrared_bands,
    load_infrared,
    save_infrared,
    vacuum,
)
from startrack.earth.atmosphere.limb import build_limb
from startrack.earth.atmosphere.look_up import FineTable, Reach, Sight, look_up, refine
from startrack.earth.atmosphere.radiance import Heat, Terms, heat_of, planck, radiance
from startrack.earth.atmosphere.solver import TOP, solve_radiance
from startrack.earth.atmosphere.table import Air, AirTable, load_table, save_table
from startrack.earth.atmosphere.view import at_sensor, sight_of

# Public; the other imports serve other rooms.
__all__ = [
    "Air",
    "AirTable",
    "BandTable",
    "FineTable",
    "Grid",
    "Heat",
    "InfraredTable",
    "Reach",
    "Sight",
    "Terms",
    "at_sensor",
    "build",
    "build_limb",
    "heat_of",
    "in_bands",
    "infrared_bands",
    "load_infrared",
    "load_table",
    "look_up",
    "planck",
    "radiance",
    "refine",
    "save_infrared",
    "save_table",
    "sight_of",
    "vacuum",
]
