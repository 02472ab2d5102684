"""The spectrum of level ground at the sensor, and the rectangle of each channel's band."""

import math
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Refused, printed, um
from startrack.earth import atmosphere, geometry
from startrack.earth.imager import (
    INFRARED,
    Survey,
    air_table,
    band_of,
    cover_at,
    mean_wavelength,
    table_in_bands,
)
from startrack.earth.retrieval.patch import level_ground

TOGETHER = 200  # wavelengths computed at once


@printed
class Rectangle(NamedTuple):
    """A band as a rectangle with the same area, mean and variance of wavelength.

    name         name of the channel
    low, high    metre
    radiance     watt / m^2 / sr / m, mean over the band
    """

    name: str
    low: float
    high: float
    radiance: float


@printed
class GroundSpectrum(NamedTuple):
    """A spectrum at the sensor.

    wavelength  (n,) metre, nodes of the air's table
    radiance    (n,) watt / m^2 / sr / m, ground and air
    path        (n,) watt / m^2 / sr / m, air over black ground
    bands       of the channels within the range
    """

    wavelength: Floats
    radiance: Floats
    path: Floats
    bands: tuple[Rectangle, ...]


def ground_spectrum(
    survey: Survey, low: float, high: float, height: float = 0.0, sun_zenith: float = 0.7
) -> GroundSpectrum:
    """Reflected sunlight of level ground straight below; the surroundings have the same cover.

    low, high   metre, limits of wavelength
    height      metre above the sea
    sun_zenith  radian
    Raises      ValueError if the scene has no air, its air has no table, or the table does not
                cover the range.
    Accuracy    numerical: means over the cells of the air's table: 1 nm up to 1 um and 5 nm beyond;
                a user's table has its own cells. model: thermal radiance is left out.
    """
    table = air_table(survey.air, infrared=False)
    if isinstance(table, atmosphere.InfraredTable):
        raise Refused("a scene must have the table [air] for the spectrum at the sensor")
    spectrum = table.spectrum
    used = np.flatnonzero((spectrum >= low) & (spectrum <= high))
    if len(used) < 2 or not spectrum[0] <= low < high <= spectrum[-1]:
        raise Refused(
            f"wavelengths must rise, from {spectrum[0] / um:.2f} to {spectrum[-1] / um:.2f} um, "
            f"got {low / um:.4g} to {high / um:.4g} um"
        )
    above = geometry.flight_height(survey.carrier) - height
    around = cover_at(survey.land, height).reflectance(spectrum[used])
    ground, step = level_ground(1, height, sun_zenith), np.gradient(spectrum)
    light: list[Floats] = []
    path: list[Floats] = []
    for part in np.array_split(np.arange(len(used)), math.ceil(len(used) / TOGETHER)):
        response = np.zeros((len(part), len(spectrum)))
        response[np.arange(len(part)), used[part]] = 1 / step[used[part]]
        bands = table_in_bands(table, response, above, survey.distance_to_sun)
        for total, own in ((light, around[part][None]), (path, np.zeros((1, len(part))))):
            terms = atmosphere.at_sensor(ground, bands, own, around[part])
            total.append(terms.total[0].astype(np.float64))
    wavelength, radiance = spectrum[used], np.concatenate(light)
    return GroundSpectrum(
        wavelength, radiance, np.concatenate(path), _rectangles(survey, above, wavelength, radiance)
    )


def _rectangles(
    survey: Survey, above: float, wavelength: Floats, radiance: Floats
) -> tuple[Rectangle, ...]:
    made = []
    for channel in survey.camera.channels:
        place = mean_wavelength(channel)
        if place > INFRARED or not wavelength[0] <= place <= wavelength[-1]:
            continue
        band = band_of(channel, survey.air, above, survey.distance_to_sun)
        mean = float(band.weight @ band.wavelength)
        half = math.sqrt(3 * float(band.weight @ (band.wavelength - mean) ** 2))
        if wavelength[0] <= mean - half and mean + half <= wavelength[-1]:
            inside = np.interp(band.wavelength, wavelength, radiance)
            made.append(
                Rectangle(channel.name, mean - half, mean + half, float(band.weight @ inside))
            )
    return tuple(made)
