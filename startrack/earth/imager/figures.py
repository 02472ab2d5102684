"""Ground resolution, swath, MTF, SNR, dynamic range and data rate of a channel in flight."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from startrack.core import FieldPsf, deg, um
from startrack.detector import Detector
from startrack.earth.atmosphere import Reach, Sight, radiance, refine
from startrack.earth.geometry import fly, ground_rate
from startrack.earth.imager.band import INFRARED, Band, band_of
from startrack.earth.imager.lens import field_lens, image_pixels
from startrack.earth.imager.parameters import Channel, Performance, Survey, exposure_of, smear
from startrack.earth.terrain import geodetic
from startrack.optics import blur_transfer, modulation, pixel_transfer, pupil_transfer

PLACES = 17  # along a line, whose lowest MTF is taken
GREY, WARM, SUN = 0.2, 300.0, 50 * deg  # the scene of the reference radiance; chosen by hand


@dataclass(frozen=True)
class Figures:
    """Performance of one channel over flat ground below.

    gsd               metre, footprint: side of a pixel projected on the ground
    sampling_across, sampling_along  metre between columns and between lines: ground sample
                      distances
    swath, field      metre; radian
    rayleigh          metre, on the ground: 1.22 lambda H / D
    mtf_across, mtf_along  1, at half a cycle per pixel, or per `average` pixels: lens, blur, pixel,
                      smear. The Nyquist frequency of staggered lines is twice that, where the
                      MTF of a pixel is 0. With a lens table the lowest over the field
    illumination      1, of the darkest pixel over that of the middle; None without a lens table.
                      SNR and saturation are those of the middle
    radiance          watt / m^2 / sr / m, of the SNR
    electrons, noise  electron, of this radiance
    snr               1; of the mean of `average` columns, as all that follows
    noise_radiance    watt / m^2 / sr / m, of the noise of this radiance
    nedt              kelvin, the same as a difference of temperature of a blackbody of the
                      reference temperature (300 K where there is none); None below 3 micrometre
    saturation        watt / m^2 / sr / m that reaches the full-well capacity, or the largest number
    dynamics          1, dynamic range: full-well capacity over the noise in the dark
    period, clock     second between lines; pixel / second
    data_rate         bit / second
    """

    gsd: float
    sampling_across: float
    sampling_along: float
    swath: float
    field: float
    rayleigh: float
    mtf_across: float
    mtf_along: float
    illumination: float | None
    radiance: float
    electrons: float
    noise: float
    snr: float
    noise_radiance: float
    nedt: float | None
    saturation: float
    dynamics: float
    period: float
    clock: float
    data_rate: float


def figures(
    channel: Channel, band: Band, height: float, rate: float, light: float | None = None
) -> Figures:
    """Figures of one channel.

        footprint = H p / f,  swath = 2 H tan(field / 2),  MTF = lens x blur x pixel x smear

    Source: Krutz et al. (2011), section 2.1, and eq. (4).

    height  metre above the ground
    rate    radian / second of the ground below
    light   watt / m^2 / sr / m; None for that of the channel, else that of `reference`
    Raises    ValueError as `field_lens`, of a lens table that does not hold field or band.
    Accuracy  model: flat ground; without a lens table, a lens without aberrations beyond its blur,
              at the mean wavelength.
    """
    optics, detector = channel.optics, channel.detector
    focal, pitch = optics.image_distance, detector.pitch
    footprint = height * pitch / focal
    half = math.atan(detector.columns / 2 * pitch / focal)
    wavelength = float(band.weight @ band.wavelength)
    square = pitch / focal / rate / (2 if channel.kind == "staggered" else 1)
    period = (channel.period or square) if detector.scan else 1 / detector.update_rate
    columns = footprint * channel.average * detector.columns / channel.columns
    lines = period * rate * height if detector.scan else footprint
    exposure = exposure_of(channel, period)
    drift = smear(channel, period if detector.scan else 0.0, rate) * pitch
    per_radiance = channel.etendue() * exposure * band.electrons
    light = _light(channel, band) if light is None else light
    electrons = per_radiance * light
    dark = detector.dark_rate * exposure
    noise = _noise(detector, electrons, dark)
    mean_noise = noise / math.sqrt(channel.average)
    if optics.tabulated:
        across, along, illumination = _lens_over_field(channel, band, rate, drift)
    else:
        across = sharpness(channel, wavelength, 0.0, channel.average)
        along, illumination = sharpness(channel, wavelength, drift), None
    numbers = 2**detector.bits - 1
    full = detector.full_well * min(1.0, (1 - detector.offset / numbers) / detector.gain)
    return Figures(
        footprint, columns, lines, 2 * height * math.tan(half), 2 * half,
        1.22 * wavelength * height / optics.aperture,
        across, along, illumination,
        light, electrons, noise, electrons / mean_noise, mean_noise / per_radiance,
        _temperature_step(channel, band, mean_noise / per_radiance), full / per_radiance,
        detector.full_well / _noise(detector, 0.0, dark),
        period, channel.columns / period * (1 if detector.scan else detector.rows),
        channel.columns * detector.bits / period * (1 if detector.scan else detector.rows),
    )  # fmt: skip


def figures_of(survey: Survey) -> Iterator[tuple[Channel, float, Figures]]:
    """Each channel of a survey's camera, its height in metre at the epoch, and its figures.

    Where a channel has a reference light, that is the light at the lens.
    """
    carrier = survey.carrier
    height = float(geodetic(fly(carrier, np.zeros(1)).position)[2][0])
    rate = ground_rate(carrier)
    for channel in survey.camera.channels:
        air = None if channel.reference else survey.air
        band = band_of(channel, air, height, survey.sun_distance)
        yield channel, height, figures(channel, band, height, rate)


def margins_of(channel: Channel, found: Figures) -> dict[str, float]:
    """Margin of each requirement of a channel, over the requirement; met where it is 0 or more.

    Those of GSD and NEdT are limits from above.
    """
    predicted = {
        "snr": found.snr,
        "nedt": found.nedt,
        "mtf": min(found.mtf_across, found.mtf_along),
        "saturation": found.saturation,
        "gsd": found.sampling_across,
    }
    margins = {}
    for name, limit in known(channel.required).items():
        value = predicted[name]
        if value is None:
            raise ValueError(f"channel {channel.name}: required.{name} must be left out below 3 um")
        margins[name] = (value / limit - 1) * (-1 if name in ("nedt", "gsd") else 1)
    return margins


def known(performance: Performance) -> dict[str, float]:
    """The values that are given, by their names."""
    return {name: value for name, value in vars(performance).items() if value is not None}


def sharpness(channel: Channel, wavelength: float, drift: float, merged: int = 1) -> float:
    """MTF along one axis at half a cycle per pixel, or per `average` pixels.

    drift   metre on the detector, of the image in an exposure
    merged  pixels along this axis that are averaged
    """
    nyquist = np.array([0.5 / channel.detector.pitch / channel.average])
    optics, side = channel.optics, channel.detector.pitch * math.sqrt(channel.detector.fill_factor)
    lens = pupil_transfer(nyquist, wavelength, optics.working_f_number)
    blur = blur_transfer(nyquist, math.hypot(optics.total_blur, channel.detector.diffusion))
    mean = _merged(channel) if merged > 1 else 1.0
    both = pixel_transfer(nyquist, side) * pixel_transfer(nyquist, drift)
    return float((lens * blur * np.abs(both))[0] * mean)


def _lens_over_field(
    channel: Channel, band: Band, rate: float, drift: float
) -> tuple[float, float, float]:
    """Lowest MTF across and along, and illumination, over the field of a lens table."""
    sensor = channel.sensor(1, rate)
    lens = field_lens(channel, sensor, channel.optics, band.wavelength, band.weight)
    assert isinstance(lens.images, FieldPsf)
    assert lens.light is not None
    columns, rows = image_pixels(channel, sensor)
    nyquist = np.array([0.5 / channel.average])
    colour, found = float(lens.images.colour[0]), []
    for y in np.unique(rows[[0, len(rows) // 2, -1]]).tolist():
        for x in np.linspace(columns[0], columns[-1], PLACES).tolist():
            image = lens.images.image(x, y, colour)[0]
            values = [modulation(image, nyquist, turn)[0] for turn in (0.0, math.pi / 2)]
            found.append(np.array(values) / image.energy)
    across, along = np.min(found, axis=0)
    along *= abs(pixel_transfer(nyquist / channel.detector.pitch, drift)[0])
    middle = lens.light[len(rows) // 2, channel.columns // 2]
    return float(across * _merged(channel)), float(along), float(lens.light.min() / middle)


def _merged(channel: Channel) -> float:
    """MTF of the mean of `average` columns at their Nyquist frequency."""
    turn = math.pi / channel.average * np.arange(channel.average)
    return float(abs(np.mean(np.exp(1j * turn))))


def reference(band: Band) -> float:
    """Mean spectral radiance of grey land below: reflectance 0.2, 300 K, Sun at 50 deg from zenith.

    Returns  watt / m^2 / sr / m
    """
    ones = np.ones(1)
    geometry = 0.0, 0.0, SUN, math.pi / 2
    fine = refine(band.table, Reach(*((one, one) for one in geometry)))
    sight = Sight(*(one * ones for one in (*geometry, math.cos(SUN), 1.0, 1.0)))
    grey = np.full(1, GREY)
    return float(radiance(fine, sight, grey, grey, band.heat, WARM * ones).total[0, 0])


def _light(channel: Channel, band: Band) -> float:
    """Watt / m^2 / sr / m for which a channel's SNR is required, else that of grey land."""
    wanted = channel.reference
    if wanted is None:
        return reference(band)
    if wanted.radiance is not None:
        return wanted.radiance
    if band.heat is None:
        raise ValueError(
            f"channel {channel.name}: reference.temperature must be left out below "
            f"{INFRARED / 2 / um:.1f} um, got {wanted.temperature:g} K"
        )
    return float(band.heat(np.array([wanted.temperature]))[0, 0])


def _temperature_step(channel: Channel, band: Band, step: float) -> float | None:
    """Kelvin that change the radiance of a blackbody in front of the lens by `step`."""
    if band.heat is None or float(band.weight @ band.wavelength) < INFRARED:
        return None
    wanted = channel.reference.temperature if channel.reference else None
    near = (WARM if wanted is None else wanted) + np.array([-0.5, 0.5])
    return float(step / np.diff(band.heat(near)[:, 0])[0])


def _noise(detector: Detector, electrons: float, dark: float) -> float:
    """Electron rms: shot noise, read noise, quantisation, PRNU."""
    step = detector.electrons_per_dn
    return math.sqrt(
        electrons + dark + detector.noise**2 + step**2 / 12 + (detector.prnu * electrons) ** 2
    )
