"""Air between ground and sensor: radiation from tables, in two steps.

parameters  Air: aerosol, visibility, water, ozone

first step, with the extra `earth`:
aerosol     type and visibility -> extinction over height, phase function
mie         sizes and refractive index -> how particles scatter light
gases       water, ozone, mixed gases and the Sun's spectrum
solver      particles and layers -> radiance at sensors
engine      sasktran2, or a sentence on how to get it
build       Air -> AirTable

table       AirTable, and its file
checked     FITS file -> its parts, or a sentence

runs        another program's runs at three albedos -> BandTable at each wavelength
modtran     files of MODTRAN -> Run
uvspec      files of libRadtran -> Run

second step:
bands       AirTable and bands -> BandTable
look_up     BandTable and where pixels look -> the Sun's three terms
infrared    InfraredTable and bands -> BandTable: beyond 3 micrometre, and without air
heat        temperature -> a blackbody in bands
radiance    -> the five terms of the radiance at the sensor
view        Ground -> the same, for all rays of an image

limb        tangent height and place of the Sun -> radiance of the limb
"""

from startrack.scene.air.bands import BandTable, in_bands
from startrack.scene.air.build import Grid, build
from startrack.scene.air.heat import Heat, heat_of, planck
from startrack.scene.air.infrared import (
    InfraredTable,
    infrared_bands,
    load_infrared,
    save_infrared,
    vacuum,
)
from startrack.scene.air.limb import Limb, build_limb, load_limb, save_limb
from startrack.scene.air.look_up import FineTable, Reach, Sight, look_up, refine
from startrack.scene.air.parameters import Air
from startrack.scene.air.radiance import Terms, radiance
from startrack.scene.air.table import AirTable, load_table, save_table
from startrack.scene.air.view import at_sensor, sight_of

__all__ = [
    "Air",
    "AirTable",
    "BandTable",
    "FineTable",
    "Grid",
    "Heat",
    "InfraredTable",
    "Limb",
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
    "load_limb",
    "load_table",
    "look_up",
    "planck",
    "radiance",
    "refine",
    "save_infrared",
    "save_limb",
    "save_table",
    "sight_of",
    "vacuum",
]
