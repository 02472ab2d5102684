"""BandTable and thermal radiance of one channel, weighted with its response."""

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from startrack import core
from startrack.core import Floats, Refused, printed, um
from startrack.earth import atmosphere
from startrack.earth.atmosphere import BandTable
from startrack.earth.imager.parameters import Channel
from startrack.earth.terrain import Ground
from startrack.io import shipped

INFRARED = 3 * um  # a band beyond is infrared: thermal radiance exceeds scattered light there
# Shipped tables by type of aerosol, clearest first.
TABLES = {
    "rural": ("molecules", "rural-23km", "rural-5km"),
    "urban": ("molecules", "urban-23km"),
    "maritime": ("molecules", "maritime-23km"),
}
CLEAR = ("molecules",)
# metre, least visibility of each type's tables
HAZIEST = {"rural": 5e3, "urban": 23e3, "maritime": 23e3}
SCATTERERS = "rural-23km"  # the aerosol of the table beyond 3 um
OUTER = 0.2 * um, 60 * um  # metre, limits of the wavelengths that a channel detects
TableOfAir = atmosphere.AirTable | atmosphere.RadianceTable | atmosphere.InfraredTable
FEWEST = 3  # least number of wavelengths of a user's table inside a band
LEAST = 0.98  # least fraction of a band's response that a table must cover; chosen by hand


@printed
class Band(NamedTuple):
    """One channel and the air in its band.

    wavelength, weight  (f,) metre; (f,) 1, nodes of integrals over the band and their weights, the
                        normalised response to a constant spectral radiance
    electrons           electron metre / joule, response integrated over the band: electrons per
                        second, per unit of etendue and of spectral radiance
    table               table of the air with this band alone: mean spectral radiances, watt / m^2 /
                        sr / m
    heat                mean spectral radiance of a blackbody in the band, in the same unit
    irradiance          watt / m^2 / m, mean spectral irradiance of the Sun above the air
    """

    wavelength: Floats
    weight: Floats
    electrons: float
    table: BandTable
    heat: atmosphere.ThermalRadiance | None
    irradiance: float


def band_of(
    channel: Channel, air: atmosphere.Air | None, altitude: float, sun_distance: float
) -> Band:
    """The band of a channel.

        L = Int R L(lambda) dlambda / Int R dlambda,   R = lambda / (h c) filter tau QE

    air       None: a planet without air; beyond 3 micrometre always the table of mid-latitude
              summer
    altitude  metre above the ground
    Raises    ValueError if no shipped table has this air or covers this band.
    Accuracy  numerical: the response's integrals are exact between the nodes of its curves; the
              light is the mean of each cell of the table, 1 to 20 nm wide.
    """
    every, middle = _answers(channel)
    table = air_table(air, middle > INFRARED)
    step = np.gradient(table.spectrum)
    edges = atmosphere.edges_of(table.spectrum)
    place, part, cell = core.quadrature(edges, channel.curves)
    part = part * channel.photoelectrons(place)
    response = np.bincount(cell, part, len(step)) / np.diff(edges)
    if response @ step < LEAST * every:
        low, high = table.spectrum[[0, -1]] / um
        raise ValueError(
            f"channel {channel.name}: the band must lie in the air's table, {low:.2f} to "
            f"{high:.2f} um, got {100 * response @ step / every:.0f} % of it"
        )
    places = table.spectrum[response > 0] / um
    if isinstance(table, atmosphere.RadianceTable) and len(places) < FEWEST:
        raise Refused(
            f"channel {channel.name}: the air's table must have {FEWEST} wavelengths or more "
            f"inside the band, got {', '.join(f'{place:.4g} um' for place in places)}"
        )
    electrons = float(response @ step)
    flat = (response / electrons)[None]
    try:
        bands = table_in_bands(table, flat, altitude, sun_distance)
    except Refused as error:
        raise Refused(f"channel {channel.name}: {error}") from None
    if middle > INFRARED and bands.rise is None:
        raise Refused(
            f"channel {channel.name}: a table of the air must have the columns rise and fall "
            "beyond 3 um"
        )
    if isinstance(table, atmosphere.AirTable):
        sun = table.irradiance
    else:
        sun = atmosphere.sun_spectrum(table.spectrum)
    warm = atmosphere.heat_of(table.spectrum, flat) if middle > INFRARED / 2 else None
    irradiance = float((flat[0] * step) @ sun) / sun_distance**2
    used = part > 0
    weight = part[used] / part.sum()
    return Band(place[used], weight, electrons, bands, warm, irradiance)


def terms_in_band(
    ground: Ground,
    band: Band,
    reflectance: Floats,
    surroundings: Floats | float,
    temperature: Floats | None = None,
    direct: Floats | None = None,
) -> atmosphere.Terms:
    """Radiance (n,) of n rays in one band, watt / m^2 / sr / m, as `at_sensor`.

    reflectance   (n,) 1, or (1,) for all
    surroundings  1, scalar or (2, n), as for `look_up`
    temperature   (n,) kelvin; None: without thermal radiance
    direct        (n,) 1, reflectance factor for sunlight; None: `reflectance`
    """
    heat = None if temperature is None else band.heat
    around, beam = np.asarray(surroundings)[..., None], None if direct is None else direct[:, None]
    terms = atmosphere.at_sensor(
        ground, band.table, reflectance[:, None], around, heat, temperature, beam
    )
    return atmosphere.Terms(*(term[:, 0] for term in terms))


def mean_wavelength(channel: Channel) -> float:
    """Mean wavelength of a channel's response to an even spectrum of energy, metre."""
    return _answers(channel)[1]


def _answers(channel: Channel) -> tuple[float, float]:
    """Integral of the response over wavelength, and mean wavelength of the response, metre."""
    place, part, _ = core.quadrature(np.array(OUTER), channel.curves)
    part = part * channel.photoelectrons(place)
    if not part.any():
        raise ValueError(
            f"channel {channel.name}: band, transmission and quantum_efficiency must overlap "
            "between 0.2 and 60 um"
        )
    return float(part.sum()), float(part @ place / part.sum())


def table_in_bands(
    table: TableOfAir, response: Floats, altitude: float, sun_distance: float
) -> BandTable:
    """A table of any kind, weighted with the response (b, f) of each band."""
    if isinstance(table, atmosphere.AirTable):
        return atmosphere.in_bands(table, response, altitude, sun_distance)
    if isinstance(table, atmosphere.RadianceTable):
        return atmosphere.radiance_bands(table, response, altitude, sun_distance)
    return atmosphere.infrared_bands(table, response, altitude, sun_distance)


@lru_cache(maxsize=4)
def air_table(air: atmosphere.Air | None, infrared: bool) -> TableOfAir:
    """The shipped table for a state of the air, or a user's table.

    Raises  ValueError if no shipped table fits.
    """
    if air is None:
        return atmosphere.vacuum()
    if air.table:
        return atmosphere.load_user_table(Path(air.table))
    water, ozone = air.columns
    if infrared:
        if (water, ozone) != atmosphere.Air().columns:
            raise Refused(
                "climate, water and ozone of the air must be left out of a scene with a band "
                f"beyond 3 um, whose shipped table is of midlatitude summer, got {air}; "
                "air.table may name another"
            )
        heat = atmosphere.load_infrared(shipped("atmosphere/infrared.fits"))
        return replace(heat, particles=_shipped_air(SCATTERERS))
    tables = [_shipped_air(name) for name in TABLES.get(air.aerosol, CLEAR)]
    particles = atmosphere.Air(air.aerosol, air.visibility)
    found = next((table for table in tables if table.air == particles), None)
    if found is None and air.visibility < HAZIEST.get(air.aerosol, math.inf):
        raise Refused(
            "air must be none, rural from 5 to 150 km, or urban or maritime from 23 to 150 km, "
            f"got {air}; air.table may name another"
        )
    found = found or atmosphere.mixed(particles, tables)
    if (water, ozone) == found.air.columns:
        return found
    return atmosphere.with_gases(found, water, ozone)


def _shipped_air(name: str) -> atmosphere.AirTable:
    return atmosphere.load_table(shipped(f"atmosphere/{name}.fits"))
